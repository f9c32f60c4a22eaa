"""Experts in zones over several edges (5.31, 5.21) and under a least speed (4.6)."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from planner_loop import Body, World, constant, front_of, load, verdict

from tsbench.planners.base import Planner
from tsbench.planners.experts.expert import Expert
from tsbench.planners.idm import Idm, IdmS1, IdmS2, IdmS3, IdmS4
from tsbench.planners.observation import SignView
from tsbench.roads.lane_graph import Destination
from tsbench.signs.annotations import SignInstance
from tsbench.signs.rule_kinds import ZoneParams
from tsbench.sim.world import EGO_LENGTH_M

KMH = 3.6
BASES: tuple[Callable[[], Planner], ...] = (Idm, IdmS1, IdmS2, IdmS3, IdmS4)
LINE = 100.0


def target_plate(code: str, edge: str, value: float, at: float, zone: str) -> SignInstance:
    return SignInstance(
        "sign_0", code, value, edge, -1, at, 0.0, 0.0, 0.0, "target", None, ZoneParams(tuple(zone.split()))
    )


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize(("code", "end", "limit"), [("5.31", "5.32", 30.0), ("5.21", "5.22", 20.0)])
def test_a_zone_is_kept_to_on_every_edge(code: str, end: str, limit: float, base: Callable[[], Planner]) -> None:
    network = load("corridor")
    # Of the two end plates the first ends a zone that is over already.
    ends = tuple(SignView(end, limit, 0.0, 0.0, 0.0, *at, 10.0) for at in (("ab", -1, 60.0), ("bd", -1, 40.0)))
    rule = target_plate(code, "ab", limit, 150.0, "ab bd")

    def drive(planner: Planner) -> World:
        return World(network, "ab_0", 90.0, 12.0, Destination("bd", 80.0), signs=ends, target=rule).run(planner, 90.0)

    obedient, blind = drive(Expert(base())), drive(Idm())
    bd = network.lane("bd_0").index
    assert obedient.arrived
    assert max(e.speed for e in obedient.states if e.lane == bd and front_of(e) < 40.0) * KMH <= limit
    assert {v.clause for v in verdict(blind).violations} == {"over_limit"}


def min_speed(minimum: float, deficit: float, bodies: list[Body]) -> World:
    start = LINE - 30.0 - EGO_LENGTH_M / 2
    return World(
        load("long"), "ab_0", start, (minimum - deficit) / KMH, Destination("ab", LINE + 160.0), bodies=bodies,
        target=target_plate("4.6", "ab", minimum, LINE, "ab"),
    )  # fmt: skip


def leader(speed_kmh: float, gap: float) -> Body:
    front = LINE - 30.0 + gap + 4.5
    return Body("leader", ("ab_0",), front, constant(speed_kmh / KMH))


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("minimum", [40.0, 50.0])
@pytest.mark.parametrize("deficit", [12.0, 18.0])
def test_is_fast_enough_where_the_minimum_binds(base: Callable[[], Planner], minimum: float, deficit: float) -> None:
    world = min_speed(minimum, deficit, []).run(Expert(base()), 60.0)
    assert world.arrived
    assert verdict(world).engaged
    assert verdict(world).compliant
    binding = [e.speed * KMH for e in world.states if front_of(e) > LINE + 50.0]
    assert min(binding) >= minimum - 0.5
    if base is IdmS1:
        # Not faster than it has to be: its own style is far slower.
        assert max(binding) <= minimum + 4.0
        blind = min_speed(minimum, deficit, []).run(base(), 90.0)
        assert [v.clause for v in verdict(blind).violations] == ["under_minimum"]


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("gap", [12.0, 25.0, 60.0])
def test_stays_behind_a_slower_leader_near_enough_to_be_excused(base: Callable[[], Planner], gap: float) -> None:
    slow = leader(34.0, gap)
    world = min_speed(50.0, 15.0, [slow]).run(Expert(base()), 60.0)
    assert world.arrived
    assert verdict(world).compliant
    gaps = [
        poses["leader"][0] - 2.25 - (e.x + EGO_LENGTH_M / 2)
        for e, poses in zip(world.states, world.poses, strict=False)
    ]
    assert min(gaps) > 3.0


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("gap", [60.0, 110.0])
def test_stops_behind_who_stands(base: Callable[[], Planner], gap: float) -> None:
    world = min_speed(50.0, 15.0, [leader(0.0, gap)]).run(Expert(base()), 40.0)
    assert world.ego.speed < 0.2
    assert 0.5 < (LINE - 30.0 + gap) - front_of(world.ego) < 16.0
    assert verdict(world).compliant


def test_who_drives_as_fast_as_the_minimum_excuses_nothing() -> None:
    world = min_speed(40.0, 12.0, [leader(42.0, 30.0)]).run(Expert(Idm()), 60.0)
    assert verdict(world).compliant
    assert min(e.speed for e in world.states if front_of(e) > LINE + 50.0) * KMH >= 38.0
