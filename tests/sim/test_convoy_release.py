"""The convoy's release."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from simworld import ego_at

from tsbench.roads.network import RoadNetwork
from tsbench.signs.catalog import load_catalog
from tsbench.sim.convoy import (
    LEAST_DIFFERENCE_MPS,
    LOWEST_SHARE,
    RELEASE_AT_M,
    WAITS_MPS,
    WALKERS_AT_M,
    ConvoyRelease,
    Showing,
    earliest_arrival,
    predicted_arrival,
)
from tsbench.sim.scene import ConvoyPlan, WalkersPlan
from tsbench.sim.world import EGO_LENGTH_M

PLAN = ConvoyPlan("s_in_0", 4.0, 3.0, 13.89, 5.0, ("convoy_0",))


def test_who_is_shown_something_waits_needlessly_in_the_other_half() -> None:
    """By the thresholds of the rule that judges it there, at any speed that is open to it."""
    t = load_catalog().needless.thresholds
    assert pytest.approx(t["lowest_speed_ratio"] * t["cruise_ratio"]) == LOWEST_SHARE
    assert (t["least_difference_mps"], t["standing_mps"]) == (LEAST_DIFFERENCE_MPS, WAITS_MPS)
    for cruise in (5.0, 8.0, 13.89, 16.67):
        waits = Showing.of(WalkersPlan("s_in_0", 1.0, 60.0, cruise, cruise, ("walker_0",), (1.2,))).waits_mps
        open_speed = t["cruise_ratio"] * cruise
        assert waits < t["lowest_speed_ratio"] * open_speed
        assert waits <= open_speed - t["least_difference_mps"]


def slowly(to_line: float, to_zone: float, speed: float, cruise: float, turn: float) -> float:
    """The same drive in steps of a millisecond."""
    gone, time, v, dt = 0.0, 0.0, speed, 0.001
    while gone < to_zone and time < 60.0:
        cap = (turn * turn + 4.0 * max(to_line - gone, 0.0)) ** 0.5
        v = min(v + 1.5 * dt, cruise, max(cap, 0.5))
        gone += v * dt
        time += dt
    return time


@given(st.floats(0.0, 60.0), st.floats(0.5, 15.0), st.floats(0.0, 15.0), st.floats(3.0, 16.7), st.floats(1.5, 14.0))
def test_the_prediction_is_the_drive_that_it_describes(
    to_line: float, beyond: float, speed: float, cruise: float, turn: float
) -> None:
    predicted = predicted_arrival(to_line, to_line + beyond, speed, cruise, turn)
    assert predicted == pytest.approx(slowly(to_line, to_line + beyond, speed, cruise, turn), abs=0.35, rel=0.05)


def test_who_stands_still_for_ever_is_late_not_absent() -> None:
    assert predicted_arrival(0.0, 1000.0, 0.0, 0.0, 0.0) >= 60.0


@given(
    st.floats(0.0, 15.0), st.lists(st.floats(-3.0, 2.0), min_size=20, max_size=20), st.floats(0.0, 12.0),
    st.floats(0.0, 3.0),
)  # fmt: skip
def test_released_once_in_time_and_at_twelve_metres_at_the_latest(
    cross: RoadNetwork, speed: float, accelerations: list[float], lead: float, after: float
) -> None:
    plan = replace(PLAN, lead_time_s=lead, after_s=after)
    release, length = ConvoyRelease(plan, cross), cross.lane("s_in_0").line.length
    s, fired, released_at = length - 60.0 - EGO_LENGTH_M / 2, 0, None
    for tick in range(400):
        to_line = length - s - EGO_LENGTH_M / 2
        if release.update(ego_at(cross, "s_in_0", s, speed)):
            fired, released_at = fired + 1, to_line
            eta = predicted_arrival(to_line, to_line + 4.0, speed, 13.89, 5.0)
            assert eta <= lead - after or to_line <= RELEASE_AT_M
        elif fired == 0:
            assert to_line > RELEASE_AT_M
        speed = min(max(speed + accelerations[tick // 20] * 0.1, 0.0), 15.0)
        s = min(s + speed * 0.1, length - 0.1)
    assert fired <= 1
    # What the release saw last; the ego has moved on since.
    assert released_at is not None or to_line > RELEASE_AT_M


@given(st.floats(0.0, 80.0), st.floats(0.0, 20.0), st.floats(0.5, 4.0), st.floats(5.0, 22.0))
def test_nothing_that_speeds_up_as_it_can_is_there_sooner(way: float, speed: float, accel: float, top: float) -> None:
    arrival, v, gone, step = earliest_arrival(way, speed, accel, top), speed, 0.0, 1e-3
    for _ in range(round(arrival / step)):
        v = max(min(v + accel * step, top), speed)
        gone += v * step
    assert gone == pytest.approx(way, abs=0.05)


def test_a_long_lead_time_releases_at_once_and_only_then(cross: RoadNetwork) -> None:
    release = ConvoyRelease(replace(PLAN, lead_time_s=60.0), cross)
    told = [release.update(ego_at(cross, "s_in_0", s, 8.0)) for s in (20.0, 21.0, 22.0)]
    assert told == [True, False, False]


def test_who_leaves_its_lane_is_not_past_its_line(cross: RoadNetwork) -> None:
    """Beside its lane, in the oncoming one or off all lanes, the ego is as far from its line as in it."""
    release, length = ConvoyRelease(replace(PLAN, lead_time_s=0.0), cross), cross.lane("s_in_0").line.length
    oncoming = ego_at(cross, "s_out_0", 55.0, 8.0)
    aside = replace(ego_at(cross, "s_in_0", length - 55.0, 8.0, d=-3.0), lane=-1, s=0.0, d=0.0)
    assert not release.update(oncoming)
    assert not release.update(aside)
    near = replace(ego_at(cross, "s_in_0", length - 10.0, 8.0, d=3.2), lane=cross.lane_index["s_out_0"])
    assert release.update(near)
    assert not release.update(near)


def test_people_step_out_only_before_who_could_not_stop_any_more(cross: RoadNetwork) -> None:
    """However long they need: 5 m before the line for who waits, else where 6 m/s2 no longer stop it before them."""
    plan = WalkersPlan("s_in_0", 1.0, 60.0, 13.89, 13.89, ("walker_0",), (1.2,))
    length = cross.lane("s_in_0").line.length
    for speed, latest in ((3.0, 5.0), (7.0, 49 / 12 - 1), (12.0, 11.0)):
        release = ConvoyRelease(plan, cross)
        for to_line in (30.0, latest + 0.1, latest - 0.1):
            told = release.update(ego_at(cross, "s_in_0", length - to_line - EGO_LENGTH_M / 2, speed))
            assert told == (to_line < latest), (speed, to_line)


def test_people_are_let_go_nearer_than_vehicles(cross: RoadNetwork) -> None:
    length = cross.lane("s_in_0").line.length
    release = ConvoyRelease(WalkersPlan("s_in_0", 1.0, 0.0, 13.89, 13.89, ("walker_0",), (1.2,)), cross)
    told = [
        release.update(ego_at(cross, "s_in_0", length - to_line - EGO_LENGTH_M / 2, 3.0))
        for to_line in (RELEASE_AT_M, WALKERS_AT_M + 0.1, WALKERS_AT_M)
    ]
    assert told == [False, False, True]


def test_people_who_wait_until_the_ego_is_past_do(cross: RoadNetwork) -> None:
    plan = WalkersPlan("s_in_0", 1.0, 60.0, 13.89, 13.89, ("walker_0",), (1.2,), until_past=True)
    release, length = ConvoyRelease(plan, cross), cross.lane("s_in_0").line.length
    inside = cross.lanes[cross.outgoing[cross.lane("s_in_0").index][0].via[0]].id
    places = [("s_in_0", length - 20.0), ("s_in_0", length - 0.1), (inside, 1.0), ("n_out_0", 0.5), ("n_out_0", 9.0)]
    assert [release.update(ego_at(cross, *place)) for place in places] == [False, False, False, True, False]
