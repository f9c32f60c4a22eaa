"""Comfort: the share of steps within nuPlan's bounds. Source: docs/metrics.md; nuPlan, "ego is comfortable".

Derivatives come from Savitzky-Golay filters with nuPlan's windows, for differences of a signal that changes
once a tick are jumps, not jerks. The acceleration is that of the rear axle: along the heading what the
vehicle did, across it speed x yaw rate.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tsbench.geometry.polyline import Array
from tsbench.metrics.tracks import Tracks
from tsbench.sim.world import DT_S

LONGITUDINAL_MPS2 = (-4.05, 2.40)
LATERAL_MPS2 = 4.89
YAW_RATE_RAD_S = 0.95
YAW_ACCELERATION_RAD_S2 = 1.93
LONGITUDINAL_JERK_MPS3 = 4.13
JERK_MPS3 = 8.37

_ACCELERATION_WINDOW = 8
_WINDOW = 15
_SHORTEST = 4


def comfort(tracks: Tracks) -> float | None:
    """Share of steps (0-1) in which all six quantities are within their bounds; None below four ticks."""
    if len(tracks) < _SHORTEST:
        return None
    lateral = tracks.speed * tracks.yaw_rate
    raw = np.stack((tracks.acceleration, lateral, np.hypot(tracks.acceleration, lateral)))
    along, across, total = smooth(raw, _ACCELERATION_WINDOW)
    jerk_along, jerk = smooth(np.stack((along, total)), _WINDOW, derivative=1)
    yaw = np.unwrap(tracks.heading)
    low, high = LONGITUDINAL_MPS2
    fine = (along >= low) & (along <= high) & (np.abs(across) <= LATERAL_MPS2)
    fine &= np.abs(smooth(yaw, _WINDOW, derivative=1)) <= YAW_RATE_RAD_S
    fine &= np.abs(smooth(yaw, _WINDOW, derivative=2, order=3)) <= YAW_ACCELERATION_RAD_S2
    fine &= np.abs(jerk_along) <= LONGITUDINAL_JERK_MPS3
    fine &= np.abs(jerk) <= JERK_MPS3
    return float(np.count_nonzero(fine)) / len(fine)


def smooth(signal: Array, window: int, derivative: int = 0, order: int = 2) -> Array:
    """Savitzky-Golay filter along the last axis, with a window that fits short signals too.

    The same numbers as `scipy.signal.savgol_filter` (mode "interp") gives, which fits polynomials anew at every
    call, and whose import alone takes a worker longer than many episodes.
    """
    n = signal.shape[-1]
    window = min(window, n)
    middle, places = _weights(window, min(order, window - 1), derivative)
    half = window // 2
    result = np.empty_like(signal)
    # An even window has no middle sample: its middle value goes to the sample before it, as SciPy has it.
    first = (window - 1) // 2
    result[..., first : first + n - window + 1] = sliding_window_view(signal, window, axis=-1) @ middle
    result[..., :half] = signal[..., :window] @ places[:half].T
    result[..., n - half :] = signal[..., n - window :] @ places[window - half :].T
    return result


@cache
def _weights(window: int, order: int, derivative: int) -> tuple[Array, Array]:
    """Weights of the samples of a window for its middle, (window,), and for each of its places, (window, window).

    They are those of the polynomial of the given order that fits the window best, or of its derivative.
    """
    at = np.arange(window, dtype=np.float64)
    centre = (window - 1) / 2
    fit = np.linalg.pinv(np.vander(at - centre, order + 1, increasing=True))
    powers = np.arange(order + 1)
    factor = np.array([math.perm(int(p), derivative) for p in powers]) / DT_S**derivative
    exponent = np.maximum(powers - derivative, 0)
    places = (factor * (at - centre)[:, None] ** exponent) @ fit
    return (factor * 0.0**exponent) @ fit, places
