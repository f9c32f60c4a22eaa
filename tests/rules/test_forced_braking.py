"""Whose hard braking counts as the ego's doing: on the main road of a T, seen without an ego."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from labelled import network

from tsbench.geometry.overlap import ConflictZone
from tsbench.roads.junction_paths import junction_paths
from tsbench.roads.priority import RULE_FOLLOWING, PriorityVehicles
from tsbench.rules.forced_braking import ForcedBraking
from tsbench.signs.catalog import load_catalog
from tsbench.sim.world import ActorKind, Actors, ActorTable, EgoState, WorldSnapshot

NET = network("t")
PATHS = junction_paths(NET, ("w_in", "e_in"))
GIVE_WAY = load_catalog().rule("give_way").thresholds
EGO = EgoState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1, 0.0, 0.0, True)
# Lane, place of the front on it, speeds from tick to tick, route, kind.
Body = tuple[str, float, tuple[float, ...], tuple[str, str], ActorKind]
HARD = (10.0, 9.7)


def car(lane: str, s: float, *speeds: float, to: str = "e_out") -> Body:
    return lane, s, speeds, (lane.rpartition("_")[0], to), ActorKind.CAR


def watched(braking: ForcedBraking, *bodies: Body, steps: Sequence[int] = (0, 1), zone: float = 0.0) -> list[bool]:
    """Does the first body come to a halt, at each step? zone: where that with its path begins."""
    table = ActorTable(4)
    for k, (_, _, _, route, kind) in enumerate(bodies):
        table.add(f"a{k}", kind, 4.5, 1.8, route)
    finder, n, halts = PriorityVehicles(NET, PATHS, RULE_FOLLOWING), len(bodies), []
    shared = ConflictZone(0.0, 1.0, zone, zone + 1.0, np.empty((0, 2)), ())
    for k, step in enumerate(steps):
        actors = Actors(
            table, np.arange(n, dtype=np.int32), np.zeros((n, 3)), np.array([b[2][k] for b in bodies]),
            np.array([NET.lane_index[b[0]] for b in bodies], dtype=np.int32), np.array([b[1] for b in bodies]),
        )  # fmt: skip
        snapshot = WorldSnapshot(step, step * 0.1, EGO, actors)
        halts += [braking.watch(snapshot, v, shared) for v in finder.find(actors) if v.row == 0]
    return halts


def hardness(
    *bodies: Body,
    steps: Sequence[int] = (0, 1),
    entry: int = 0,
    out: int | None = None,
    first: bool = False,
    zone: float = 0.0,
) -> list[float]:
    """The braking of the first body that is forced by an ego that entered all zones at a step, and left them at one."""
    braking = ForcedBraking(GIVE_WAY, PATHS)
    watched(braking, *bodies, steps=steps, zone=zone)
    entries = dict.fromkeys(range(len(PATHS)), entry)
    exits = {} if out is None else dict.fromkeys(entries, out)
    return [one.hardness for one in braking.for_ego(entries, exits, {0} if first else set())]


@pytest.mark.parametrize(
    ("before", "speed", "counted"),
    [(10.0, 9.76, False), (10.0, 9.74, True), (10.0, 10.2, False), (2.0, 1.75, False), (17.0, 16.7, True)],
)
def test_a_vehicle_is_forced_from_the_threshold_on(before: float, speed: float, counted: bool) -> None:
    found = hardness(car("w_in_0", 60.0, before, speed))
    assert found == ([pytest.approx((before - speed) / 0.1)] if counted else [])


@pytest.mark.parametrize(
    ("before", "speed", "halts"), [(2.0, 1.9, True), (2.1, 2.0, False), (1.9, 1.8, False), (0.5, 0.5, False)]
)
def test_a_vehicle_halts_where_it_falls_below_the_least_speed(before: float, speed: float, halts: bool) -> None:
    braking = ForcedBraking(GIVE_WAY, PATHS)
    assert watched(braking, car("w_in_0", 60.0, before, speed), steps=(1, 2)) == [False, halts]


def test_braking_is_watched_until_it_is_too_late_for_each_entry() -> None:
    braking = ForcedBraking(GIVE_WAY, PATHS)
    assert [braking.over(step, (0, 3)) for step in (42, 43, 44)] == [False, False, True]
    assert not braking.over(99, ())


@pytest.mark.parametrize(
    ("entry", "out", "counted"),
    [(41, None, True), (42, None, False), (-39, 0, True), (-40, 0, False), (-40, 1, True), (-99, None, True)],
)
def test_only_what_is_near_in_time_to_the_passage_counts(entry: int, out: int | None, counted: bool) -> None:
    assert bool(hardness(car("w_in_0", 60.0, *HARD), entry=entry, out=out, zone=-32.0)) is counted


@pytest.mark.parametrize(("out", "forced"), [(None, True), (34, True), (24, True), (22, False)])
def test_a_touch_of_the_brake_is_force_where_it_was_needed(out: int | None, forced: bool) -> None:
    """32.8 m before its line, with 10 m/s, it would be there at 3.38 s."""
    assert bool(hardness(car("w_in_0", 60.0, *HARD), out=out)) is forced


def test_a_vehicle_in_the_zone_is_there_at_once() -> None:
    """At 1.0 s, and the ego was out of the zone at 0.1 s."""
    assert hardness(car("w_in_0", 60.0, 5.0, 4.7), steps=(9, 10), out=1, zone=-34.0) == [pytest.approx(3.0)]


def test_braking_too_early_hides_none_that_comes_later() -> None:
    speeds = (10.0, 9.7, 9.3)
    assert hardness(car("w_in_0", 60.0, *speeds), steps=(0, 1, 2), entry=42) == [pytest.approx(4.0)]


@pytest.mark.parametrize(("ticks", "forced"), [(4, False), (5, True)])
def test_to_brake_hard_for_long_is_force_however_far_away(ticks: int, forced: bool) -> None:
    speeds = [10.0 - 0.3 * k for k in range(ticks + 1)]
    assert bool(hardness(car("w_in_0", 60.0, *speeds), steps=range(ticks + 1), out=1)) is forced


def test_who_went_first_is_not_forced() -> None:
    assert hardness(car("w_in_0", 60.0, *HARD), first=True) == []


def test_who_was_out_of_sight_meanwhile_is_not_said_to_brake() -> None:
    assert hardness(car("w_in_0", 60.0, *HARD), steps=(0, 2)) == []
    assert hardness(car("w_in_0", 60.0, 0.0), steps=(1,)) == []


def test_who_turns_off_slows_down_for_its_own_line_until_it_is_over_it() -> None:
    assert hardness(car("w_in_0", 60.0, *HARD, to="s_out")) == []
    # Slower than the turn allows, it has no reason of its own.
    assert hardness(car("w_in_0", 60.0, 6.0, 5.7, to="s_out")) == [pytest.approx(3.0)]
    inside = next(p for p in PATHS if (p.source.edge, p.target.edge) == ("w_in", "s_out")).inner[0].id
    # SUMO sheds the speed in the tick in which the front crosses the line.
    assert hardness((inside, 0.9, HARD, ("w_in", "s_out"), ActorKind.CAR)) == []
    assert hardness((inside, 1.0, HARD, ("w_in", "s_out"), ActorKind.CAR)) == [pytest.approx(3.0)]
    # It gives way to who comes towards it, at whatever speed.
    assert hardness(car("e_in_0", 60.0, 6.0, 5.7, to="s_out")) == []


@pytest.mark.parametrize(
    ("rear", "speed", "kind", "excused"),
    [
        (89.9, 5.0, ActorKind.CAR, True),
        (90.1, 5.0, ActorKind.CAR, False),
        (62.0, 5.0, ActorKind.CAR, True),
        (75.0, 9.9, ActorKind.BUS, True),
        (75.0, 10.0, ActorKind.CAR, False),
        (75.0, 5.0, ActorKind.PEDESTRIAN, False),
        (50.0, 5.0, ActorKind.CAR, False),
    ],
)
def test_a_slower_one_near_ahead_explains_it(rear: float, speed: float, kind: ActorKind, excused: bool) -> None:
    ahead = ("w_in_0", rear + 4.5, (speed, speed), ("w_in", "e_out"), kind)
    assert (hardness(car("w_in_0", 60.0, *HARD), ahead) == []) is excused


def test_the_one_ahead_may_be_in_the_junction_or_behind_it() -> None:
    behind = ("e_out_0", 5.0, (0.0, 0.0), ("s_in", "e_out"), ActorKind.CAR)
    assert hardness(car("w_in_0", 90.0, *HARD), behind) == []
    inside = next(p for p in PATHS if (p.source.edge, p.target.edge) == ("w_in", "e_out")).inner[0].id
    assert hardness(car("w_in_0", 90.0, *HARD), (inside, 9.0, (0.0, 0.0), ("w_in", "e_out"), ActorKind.CAR)) == []
    # 7.8 m ahead at most.
    slow, last = (
        car("w_in_0", 90.0, 2.6, 2.3),
        [(inside, place, (0.0, 0.0), ("w_in", "e_out"), ActorKind.CAR) for place in (9.4, 9.6)],
    )
    assert [hardness(slow, one) != [] for one in last] == [False, True]
    waits, turns = next(p for p in PATHS if (p.source.edge, p.target.edge) == ("e_in", "s_out")).inner
    ahead = (turns.id, 5.0, (0.0, 0.0), ("e_in", "s_out"), ActorKind.CAR)
    assert hardness((waits.id, 2.0, (3.0, 2.7), ("e_in", "s_out"), ActorKind.CAR), ahead) == []
    elsewhere = ("w_out_0", 5.0, (0.0, 0.0), ("s_in", "w_out"), ActorKind.CAR)
    assert hardness(car("w_in_0", 90.0, *HARD), elsewhere) != []
