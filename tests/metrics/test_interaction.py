"""Efficiency, time to collision and post-encroachment time against cases worked out by hand."""

from __future__ import annotations

import math

import episode_builders as made
import numpy as np
import pytest

from tsbench.metrics.interaction import _near_pairs, efficiency, min_pet, min_ttc
from tsbench.metrics.tracks import Tracks, tracks_of
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M, ActorKind, EgoState


def tracks(egos: list[EgoState], *others: made.Track) -> Tracks:
    return tracks_of(made.snapshots(egos, others))


def driving(n: int, speed: float, x: float = 0.0, y: float = -4.8) -> list[EgoState]:
    return [made.ego(x + speed * 0.1 * k, y, speed=speed) for k in range(n)]


def test_efficiency_is_the_mean_over_steps() -> None:
    near = made.Track("a", made.straight(3, 20.0, 0.0, 0.0, 10.0))
    nearer = made.Track("b", made.straight(3, 10.0, 0.0, 0.0, 30.0))
    assert efficiency(tracks(driving(3, 10.0), near, nearer)) == pytest.approx(50.0)


def test_efficiency_leaves_out_steps_without_a_moving_vehicle() -> None:
    standing = made.Track("a", made.straight(4, 20.0, 0.0, 0.0, 0.0))
    walker = made.Track("w", made.straight(4, 20.0, 0.0, 0.0, 2.0), ActorKind.PEDESTRIAN, (0.4, 0.4))
    far = made.Track("f", made.straight(4, 60.0, 0.0, 0.0, 9.0))
    assert efficiency(tracks(driving(4, 5.0), standing, walker, far)) is None
    assert efficiency(tracks(driving(4, 5.0))) is None
    leaving = made.straight(4, 10.0, 0.0, 0.0, 10.0)
    leaving[2:] = np.nan
    assert efficiency(tracks(driving(4, 5.0), made.Track("l", leaving), far)) == pytest.approx(50.0)


def test_ttc_behind_a_slower_car() -> None:
    # Gap between the bumpers 20 m, closing speed 5 m/s: 4 s, and 0.1 s less with every tick.
    other = made.Track("a", made.straight(3, 20.0 + (EGO_LENGTH_M + 4.0) / 2, -4.8, 0.0, 10.0))
    assert min_ttc(tracks(driving(3, 15.0), other)) == pytest.approx(3.8)


def test_ttc_of_crossing_ways() -> None:
    # The other's front side reaches the ego's strip first; the ego's front reaches the other's strip later.
    ahead = 30.0
    other = made.Track("a", made.straight(2, ahead, 20.0 - 4.8, -math.pi / 2, 10.0))
    in_strip = (20.0 - EGO_WIDTH_M / 2 - 2.0) / 10.0
    reached = (ahead - EGO_LENGTH_M / 2 - 1.0) / 15.0
    out_of_strip = (20.0 + EGO_WIDTH_M / 2 + 2.0) / 10.0
    assert in_strip < reached < out_of_strip
    assert min_ttc(tracks(driving(2, 15.0), other)) == pytest.approx(reached - 0.1)


@pytest.mark.parametrize(
    "other",
    [
        made.straight(3, 30.0, 1.6, math.pi, 15.0),  # oncoming on its own lane
        made.straight(3, 30.0, -4.8, 0.0, 15.0),  # ahead and as fast
        made.straight(3, -15.0, -4.8, 0.0, 30.0),  # closing in from behind
        made.straight(3, 190.0, -4.8, 0.0, 0.0),  # beyond ten seconds
        made.straight(3, 30.0, 40.0, math.pi / 2, 10.0),  # has crossed
    ],
)
def test_no_collision_course(other: made.Array) -> None:
    assert min_ttc(tracks(driving(3, 15.0), made.Track("a", other))) is None


def test_ttc_says_nothing_of_a_standing_ego() -> None:
    other = made.Track("a", made.straight(3, 20.0, -4.8, math.pi, 10.0))
    assert min_ttc(tracks(driving(3, 0.0), other)) is None
    assert min_ttc(tracks(driving(3, 0.0))) is None


def test_ttc_of_footprints_that_touch_is_zero() -> None:
    other = made.Track("a", made.straight(1, 4.0, -4.8, 0.0, 0.0))
    assert min_ttc(tracks(driving(1, 5.0), other)) == 0.0


def test_pet_of_crossing_ways() -> None:
    # The ego leaves the crossing place at x = 30 when its rear is past the other's near side.
    n, v = 100, 10.0
    leaves = (30.0 + 1.0 + EGO_LENGTH_M / 2) / v
    other = made.Track("a", made.straight(n, 30.0, 60.0 - 4.8, -math.pi / 2, 12.0))
    comes = (60.0 - 2.0 - EGO_WIDTH_M / 2) / 12.0
    assert min_pet(tracks(driving(n, v), other)) == pytest.approx(comes - leaves, abs=0.2)
    assert comes - leaves > 1.0


def test_pet_is_the_same_whoever_comes_first() -> None:
    n = 120
    early = made.Track("a", made.straight(n, 50.0, 20.0 - 4.8, -math.pi / 2, 10.0))
    leaves, comes = (20.0 + EGO_WIDTH_M / 2 + 2.0) / 10.0, (50.0 - EGO_LENGTH_M / 2 - 1.0) / 10.0
    assert min_pet(tracks(driving(n, 10.0), early)) == pytest.approx(comes - leaves, abs=0.2)


def test_no_pet_without_a_crossing() -> None:
    n = 100
    leader = made.Track("a", made.straight(n, 20.0, -4.8, 0.0, 10.0))
    oncoming = made.Track("b", made.straight(n, 90.0, 1.6, math.pi, 10.0))
    assert min_pet(tracks(driving(n, 10.0), leader, oncoming)) is None
    assert min_pet(tracks(driving(n, 10.0))) is None
    late = made.Track("c", made.straight(200, 10.0, 150.0, -math.pi / 2, 10.0))
    assert min_pet(tracks(driving(200, 10.0), late)) is None


def test_pet_of_one_who_waits() -> None:
    # It stands at the ego's way until the ego has passed, then crosses behind it.
    n = 150
    poses = made.straight(n, 40.0, -4.8 + 8.0, -math.pi / 2, 0.0)
    poses[60:, 1] -= 0.5 * np.arange(n - 60)
    leaves, comes = (40.0 + 1.0 + EGO_LENGTH_M / 2) / 10.0, 6.0 + (8.0 - 2.0 - EGO_WIDTH_M / 2) / 5.0
    assert min_pet(tracks(driving(n, 10.0), made.Track("a", poses))) == pytest.approx(comes - leaves, abs=0.2)


@pytest.mark.parametrize("stretch", [(100.0, 5.0), (5.0, 100.0), (0.0, 0.0)])
def test_near_pairs_are_those_of_all_pairs(stretch: tuple[float, float]) -> None:
    rng = np.random.default_rng(0)
    a, b = rng.uniform(-1, 1, (60, 2)) * stretch, rng.uniform(-1, 1, (80, 2)) * 60.0
    i, j = _near_pairs(a, b, 7.0)
    near = np.abs(a[:, None] - b[None]).max(axis=2) <= 7.0
    assert sorted(zip(i.tolist(), j.tolist(), strict=True)) == [tuple(p) for p in np.argwhere(near).tolist()]
