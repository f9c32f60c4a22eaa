"""The bicycle and the tracker."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from command_line import one_line
from hypothesis import given
from hypothesis import strategies as st

from tsbench.core.errors import PlannerOutputError
from tsbench.geometry.elementary import wrap
from tsbench.planners.base import Trajectory
from tsbench.sim.ego import Motion, advance, check_trajectory, pursue, track
from tsbench.sim.world import DT_S, WHEELBASE_M

HALF = WHEELBASE_M / 2
ANY = st.floats(allow_nan=False, allow_infinity=False)
STATE = st.builds(
    Motion,
    x=st.floats(-500, 500),
    y=st.floats(-500, 500),
    heading=st.floats(-math.pi, math.pi - 1e-9),
    speed=st.floats(0.0, 22.2),
    steering=st.floats(-math.radians(40), math.radians(40)),
)


def rear(m: Motion) -> tuple[float, float]:
    return m.x - HALF * math.cos(m.heading), m.y - HALF * math.sin(m.heading)


@given(STATE, st.integers(1, 60), st.floats(1.0, 20.0))
def test_constant_steering_is_an_exact_circle(start: Motion, ticks: int, speed: float) -> None:
    m = replace(start, speed=speed, steering=0.0 if abs(start.steering) < 1e-3 else start.steering)
    curvature = math.tan(m.steering) / WHEELBASE_M
    x0, y0 = rear(m)
    for _ in range(ticks):
        m = advance(m, 0.0, m.steering)
    way = ticks * speed * DT_S
    heading = start.heading + way * curvature
    assert wrap(m.heading - heading) == pytest.approx(0.0, abs=1e-9)
    x, y = rear(m)
    if curvature == 0.0:
        expected = (x0 + way * math.cos(start.heading), y0 + way * math.sin(start.heading))
    else:
        cx, cy = x0 - math.sin(start.heading) / curvature, y0 + math.cos(start.heading) / curvature
        expected = (cx + math.sin(heading) / curvature, cy - math.cos(heading) / curvature)
    assert (x, y) == pytest.approx(expected, abs=1e-5)


@given(STATE, ANY, ANY)
def test_no_command_breaks_the_vehicle_limits(m: Motion, acceleration: float, steering: float) -> None:
    n = advance(m, acceleration, steering)
    assert 0.0 <= n.speed <= 22.2
    assert -6.0 - 1e-9 <= (n.speed - m.speed) / DT_S <= 3.0 + 1e-9
    assert n.acceleration == pytest.approx((n.speed - m.speed) / DT_S)
    assert abs(n.steering) <= math.radians(40) + 1e-12
    assert abs(n.steering - m.steering) <= math.radians(60) * DT_S + 1e-12
    assert -math.pi <= n.heading < math.pi
    assert n.yaw_rate == pytest.approx(wrap(n.heading - m.heading) / DT_S, abs=1e-6)
    # It never moves backwards, and never further than its speed allows.
    (x0, y0), (x1, y1) = rear(m), rear(n)
    assert (x1 - x0) * math.cos(m.heading) + (y1 - y0) * math.sin(m.heading) >= -1e-9
    assert math.hypot(x1 - x0, y1 - y0) <= max(m.speed, n.speed) * DT_S + 1e-9


def test_braking_to_a_stand_takes_the_way_of_physics() -> None:
    m = Motion(0.0, 0.0, 0.0, 12.0)
    ticks = 0
    while m.speed > 0.0:
        m, ticks = advance(m, -6.0, 0.0), ticks + 1
    assert ticks == pytest.approx(20, abs=1)  # rounding may leave a crumb for one more tick
    assert m.x == pytest.approx(12.0**2 / (2 * 6.0))
    stood = m
    for _ in range(10):
        m = advance(m, -6.0, 0.5)
    assert (m.x, m.y, m.heading, m.speed) == (stood.x, stood.y, stood.heading, 0.0)
    assert m.acceleration == 0.0


def test_the_wheel_takes_time() -> None:
    m = Motion(0.0, 0.0, 0.0, 5.0)
    turned = []
    for _ in range(8):
        m = advance(m, 0.0, 1.0)
        turned.append(math.degrees(m.steering))
    assert turned == pytest.approx([6, 12, 18, 24, 30, 36, 40, 40])


def horizon(path: list[Motion], k: int) -> Trajectory:
    ahead = path[k + 1 : k + 31]
    return Trajectory(DT_S * np.arange(1, len(ahead) + 1), np.array([[p.x, p.y, p.heading] for p in ahead]))


@given(
    st.floats(5.0, 14.0),
    st.lists(st.tuples(st.floats(-1.5, 1.5), st.floats(-0.12, 0.12)), min_size=4, max_size=4),
    st.floats(-0.4, 0.4),
)
def test_the_tracker_follows_what_the_vehicle_can_drive(
    speed: float, phases: list[tuple[float, float]], aside: float
) -> None:
    reference = [Motion(0.0, 0.0, 0.3, speed)]
    for acceleration, steering in phases:
        for _ in range(25):
            m = reference[-1]
            # Sideways at most 3 m/s2, as a planner would ask for.
            most = math.atan(3.0 * WHEELBASE_M / max(m.speed, 1.0) ** 2)
            floor = acceleration if m.speed > 4.0 else max(acceleration, 0.0)
            reference.append(advance(m, floor, min(max(steering, -most), most)))
    start = reference[0]
    m = replace(start, x=start.x - aside * math.sin(0.3), y=start.y + aside * math.cos(0.3))
    for k in range(len(reference) - 31):
        m = advance(m, *track(m, *_arrays(horizon(reference, k))))
        r = reference[k + 1]
        if k >= 40:
            dx, dy = m.x - r.x, m.y - r.y
            along = dx * math.cos(r.heading) + dy * math.sin(r.heading)
            across = -dx * math.sin(r.heading) + dy * math.cos(r.heading)
            assert abs(across) < 0.35
            assert abs(along) < 1.0
            assert abs(m.speed - r.speed) < 0.7


def _arrays(t: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    return t.times, t.poses


def test_a_trajectory_that_stands_still_stops_the_car() -> None:
    m = Motion(0.0, 0.0, 0.0, 3.0)
    for _ in range(40):
        here = np.array([[m.x, m.y, 0.0]])
        m = advance(m, *track(m, np.array([0.5]), here))
    assert m.speed == pytest.approx(0.0, abs=1e-6)


def test_pursuit_steers_towards_the_point_and_not_at_one_underneath() -> None:
    assert pursue(0, 0, 0, 10, 2) > 0 > pursue(0, 0, 0, 10, -2)
    assert pursue(0, 0, 0, 10, 0) == 0.0
    assert pursue(0, 0, 0, -HALF, 0.1) == 0.0
    # The arc through the rear axle and the target has the curvature that the wheel gives.
    tan = math.tan(pursue(0, 0, 0, 8 - HALF, 3))
    radius = (8**2 + 3**2) / (2 * 3)
    assert WHEELBASE_M / tan == pytest.approx(radius)


BAD = {
    "NaN": ([0.5, 1.0], [[1, 0, 0], [math.nan, 0, 0]]),
    "infinity": ([0.5, math.inf], [[1, 0, 0], [2, 0, 0]]),
    "shapes": ([0.5, 1.0], [[1, 0], [2, 0]]),
    "empty": ([], np.zeros((0, 3))),
    "(1001,)": (np.arange(1, 1002) * 0.1, np.zeros((1001, 3))),
    "(2, 1)": ([[0.5], [1.0]], [[1, 0, 0], [2, 0, 0]]),
    "positive and increasing": ([0.0, 1.0], [[1, 0, 0], [2, 0, 0]]),
    "increasing": ([1.0, 1.0], [[1, 0, 0], [2, 0, 0]]),
}


@pytest.mark.parametrize("words", sorted(BAD))
def test_bad_trajectories_are_refused_in_words(words: str) -> None:
    times, poses = (np.asarray(v, dtype=np.float64) for v in BAD[words])
    with one_line(words, kind=PlannerOutputError):
        check_trajectory(times, poses)
