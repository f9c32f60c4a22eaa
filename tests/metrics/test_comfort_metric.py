"""Comfort: the filter is SciPy's, the bounds are nuPlan's."""

from __future__ import annotations

import math

import episode_builders as made
import numpy as np
import pytest
from scipy.signal import savgol_filter

from tsbench.metrics.comfort import comfort, smooth
from tsbench.metrics.tracks import tracks_of
from tsbench.sim.world import DT_S, EgoState


def driven(acceleration: list[float], yaw_rate: list[float] | None = None, speed: float = 10.0) -> list[EgoState]:
    yaw_rate = yaw_rate or [0.0] * len(acceleration)
    egos, v, heading, x = [], speed, 0.0, 0.0
    for a, w in zip(acceleration, yaw_rate, strict=True):
        v, heading, x = max(v + a * DT_S, 0.0), heading + w * DT_S, x + v * DT_S
        egos.append(made.ego(x, heading=heading, speed=v, acceleration=a, yaw_rate=w))
    return egos


def of(egos: list[EgoState]) -> float | None:
    return comfort(tracks_of(made.snapshots(egos)))


@pytest.mark.parametrize(("window", "order", "derivative"), [(8, 2, 0), (15, 2, 1), (15, 3, 2), (5, 2, 0), (4, 3, 2)])
@pytest.mark.parametrize("n", [15, 16, 200])
def test_the_filter_is_scipys(window: int, order: int, derivative: int, n: int) -> None:
    signal = np.random.default_rng(1).normal(size=(2, n))
    expected = savgol_filter(signal, window, order, deriv=derivative, delta=DT_S)
    np.testing.assert_allclose(smooth(signal, window, derivative, order), expected, rtol=1e-9, atol=1e-7)


def test_even_driving_is_comfortable() -> None:
    assert of(driven([0.0] * 100)) == 1.0
    assert of(driven([2.0] * 40)) == 1.0


@pytest.mark.parametrize(("acceleration", "share"), [(2.39, 1.0), (2.41, 0.0), (-4.04, 1.0), (-4.06, 0.0)])
def test_longitudinal_bounds(acceleration: float, share: float) -> None:
    assert of(driven([acceleration] * 40, speed=20.0)) == share


@pytest.mark.parametrize(
    ("speed", "yaw_rate", "share"), [(4.0, 0.94, 1.0), (4.0, 0.96, 0.0), (10.0, 0.48, 1.0), (10.0, 0.50, 0.0)]
)
def test_yaw_rate_and_lateral_bounds(speed: float, yaw_rate: float, share: float) -> None:
    assert of(driven([0.0] * 40, [yaw_rate] * 40, speed)) == share


def test_a_jolt_costs_the_steps_around_it() -> None:
    share = of(driven([0.0] * 100 + [-4.0] * 20 + [0.0] * 100, speed=20.0))
    # Two jolts, each felt for about the window of the filter.
    assert 1 - 2 * 15 / 220 <= share < 1


def test_yaw_acceleration() -> None:
    wobble = [0.94 * math.sin(2 * math.pi * 0.42 * k * DT_S) for k in range(150)]
    share = of(driven([0.0] * 150, wobble, speed=3.0))
    # The peaks of 2.5 rad/s2 are over the bound of 1.93 even after smoothing; a slower wobble is fine throughout.
    assert share < 1.0
    slower = [0.7 * math.sin(2 * math.pi * 0.25 * k * DT_S) for k in range(150)]
    assert of(driven([0.0] * 150, slower, speed=3.0)) == 1.0


def test_too_short_to_say() -> None:
    assert of(driven([0.0] * 3)) is None
    assert of(driven([0.0] * 4)) == 1.0
