"""Comfort: the share of steps within nuPlan's bounds. Source: spec/metrics.md; nuPlan, "ego is comfortable".

Derivatives come from Savitzky-Golay filters with nuPlan's windows, for differences of a signal that changes
once a tick are jumps, not jerks. The acceleration is that of the rear axle: along the heading what the
vehicle did, across it speed x yaw rate.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.ndimage import convolve1d
from scipy.signal import savgol_coeffs

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

    The same as `scipy.signal.savgol_filter` (mode "interp"), which fits its ends anew at every call: here
    their coefficients are kept, for twenty times the speed.
    """
    window = min(window, signal.shape[-1])
    inner, ends = _coefficients(window, min(order, window - 1), derivative)
    half = window // 2
    result: Array = convolve1d(signal, inner, mode="constant")
    result[..., :half] = signal[..., :window] @ ends[:half].T
    result[..., -half:] = signal[..., -window:] @ ends[-half:].T
    return result


@cache
def _coefficients(window: int, order: int, derivative: int) -> tuple[Array, Array]:
    """For convolution in the middle, and (window, window): the weights for each place in the window."""
    inner = savgol_coeffs(window, order, deriv=derivative, delta=DT_S)
    ends = [
        savgol_coeffs(window, order, deriv=derivative, delta=DT_S, pos=k, use="dot") for k in range(window)
    ]
    return inner, np.stack(ends)
