"""`idm-e` at junctions with a sign: the full stop, whom no plate speaks for, who is in the junction already."""

from __future__ import annotations

import pytest
from planner_loop import Body, World, car, constant, ids, load, target_plate, to_line, touched, verdict

from tsbench.planners.base import Privilege
from tsbench.planners.experts.expert import Expert
from tsbench.planners.experts.rules.conflict_check import (
    CrossingPlan,
    GapRequirement,
    ObservedVehicle,
    WayThrough,
    crossing,
    paths_through,
)
from tsbench.planners.experts.rules.gap_acceptance import COURTESY
from tsbench.planners.idm import Idm
from tsbench.roads.junction_paths import JunctionPath, junction_paths
from tsbench.roads.lane_graph import Destination
from tsbench.roads.network import RoadNetwork
from tsbench.roads.planner_map import build_planner_map
from tsbench.roads.priority import PriorityVehicle
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import load_catalog


def plate(code: str, main_in: str = "wc ec") -> SignInstance:
    return target_plate(code, "sc", at=80.0, junction="c", approach="sc", main_in=main_in)


def drive(code: str, target: str, *bodies: Body, speed: float = 8.0, **params: str) -> World:
    network = load("cross")
    start = network.lane("sc_0").line.length - 62.0
    world = World(
        network, "sc_0", start, speed, Destination(target, 60.0), bodies=list(bodies), target=plate(code, **params)
    )
    return world.run(Expert(Idm()), 60.0)


def comes(source: str, target: str, before: float, speed: float) -> Body:
    return car(load("cross"), source, target, before, constant(speed))


@pytest.mark.parametrize("target", ["cn", "cw", "ce"])
@pytest.mark.parametrize("speed", [3.6, 7.75, 13.0])
def test_stops_at_a_stop_whoever_comes(target: str, speed: float) -> None:
    world = drive("2.5", target, speed=speed)
    assert world.arrived
    assert verdict(world).compliant
    standing = [d for d, e in zip(to_line(world), world.states, strict=True) if e.speed <= 0.1 and d < 20.0]
    assert all(0.5 < d < 2.5 for d in standing)
    assert 1 <= len(standing) <= 15  # and goes on at once where nobody comes


@pytest.mark.parametrize("before", [20.0, 40.0, 60.0])
@pytest.mark.parametrize("target", ["cn", "cw", "ce"])
def test_stops_and_then_gives_way(target: str, before: float) -> None:
    world = drive("2.5", target, comes("wc", "ce", before, 7.0), comes("ec", "cw", before + 20.0, 7.0))
    assert world.arrived
    assert not touched(world)
    assert verdict(world).compliant


@pytest.mark.parametrize("code", ["2.4", "2.3.1"])
@pytest.mark.parametrize("before", [25.0, 40.0, 55.0, 70.0])
@pytest.mark.parametrize("speed", [6.0, 9.0])
def test_lets_the_arm_opposite_pass_when_it_turns_left(code: str, before: float, speed: float) -> None:
    world = drive(code, "cw", comes("nc", "cs", before, speed), comes("nc", "cs", before + 14.0, speed))
    assert world.arrived
    assert not touched(world)


def test_the_arm_opposite_waits_for_who_goes_straight_on() -> None:
    """It has to: the ego doesn't stop for a car that stands at its line and turns left."""
    world = drive("2.4", "cn", comes("nc", "ce", 1.0, 0.0))
    assert world.arrived
    assert min(e.speed for e in world.states) > 6.0


def test_waits_for_who_is_in_the_junction_whatever_its_right_of_way() -> None:
    network = load("cross")
    lanes = tuple(ids(network, "nc", "ce"))
    inside = network.lane("nc_0").line.length + 1.0
    # From the arm opposite it turns left across the ego's way, slowly, when the ego comes to the line.
    crawls = Body("n", lanes, inside - 0.6 * 6.0, lambda t, _: 0.6 if t < 6.0 else 2.0, ("nc", "ce"))
    world = drive("2.4", "cn", crawls)
    assert world.arrived
    assert not touched(world)


def test_where_the_main_road_bends_only_the_arm_on_the_right_counts() -> None:
    far = [comes("wc", "ce", d, 7.0) for d in (40.0, 52.0, 64.0)]
    right = [comes("ec", "cw", d, 7.0) for d in (40.0, 52.0, 64.0)]
    waits = drive("2.1", "cn", *right, main_in="ec")
    assert waits.arrived
    assert verdict(waits).compliant
    assert min(e.speed for e in waits.states) < 1.0
    # In this network those from the left go first; no plate of theirs says so, and the rule does not ask it.
    assert verdict(drive("2.1", "cn", *far, main_in="ec")).compliant


def passage(network: RoadNetwork, target: str, ways: tuple[JunctionPath, ...], ruled: int) -> WayThrough:
    """Where the ego's route from the south to `target` meets ways through the junction."""
    view, sign = build_planner_map(network), plate("2.4")
    path = view.graph.path(("sc", target), view.map.lane("sc_0").index, 10.0, Destination(target, 50.0))
    assert path is not None
    told = Privilege((sign,), load_catalog(), network, view)
    found = crossing(told, path, "sc", ways, ruled)
    assert found is not None
    return found


def way_pair(network: RoadNetwork, target: str) -> tuple[frozenset[str], frozenset[str]]:
    """Of a passage to `target`: ways that go first, and all that meet the ego's, as "from to"."""
    ruled = junction_paths(network, ("wc", "ec"))
    ways = (*ruled, *paths_through(network, "sc", ("wc", "ec")))
    found = passage(network, target, ways, len(ruled))
    names = [f"{w.source.edge} {w.target.edge}" for w in ways]
    first = frozenset(names[k] for k in found.first if k >= len(ruled))
    return first, frozenset(n for n, z in zip(names, found.zones, strict=True) if z is not None)


def test_right_of_way_is_read_from_the_network() -> None:
    network = load("cross")
    first, met = way_pair(network, "cw")
    assert {"nc cs", "nc cw"} <= first
    assert {"wc ce", "ec cw", "nc cs"} <= met
    first, met = way_pair(network, "ce")
    assert "nc cs" not in met
    assert "nc cw" not in first | met


def seen(s: float, speed: float, accel: float = 0.0, standing: float = 0.0, source: str = "nc") -> ObservedVehicle:
    network = load("cross")
    way = next(w for w in junction_paths(network, (source,)) if w.target.edge in ("cs", "ce"))
    zone = passage(network, "cw", (way,), 1).zones[0]
    assert zone is not None
    return ObservedVehicle(PriorityVehicle(0, 0, 0, s, 4.5, speed), way, zone, accel, standing)


PLAN = CrossingPlan(at_line=1.0, enters=2.0, left=5.0)


def test_one_who_comes_fast_is_in_the_way_and_one_who_brakes_for_its_line_is_not() -> None:
    assert COURTESY.blocks(seen(-12.0, 8.0), PLAN)
    assert not COURTESY.blocks(seen(-12.0, 4.0, accel=-1.0), PLAN)
    assert not COURTESY.blocks(seen(-60.0, 8.0), PLAN)


def test_one_who_stands_is_waited_for_a_little_while_only() -> None:
    assert COURTESY.blocks(seen(1.0, 0.2), PLAN)
    assert not COURTESY.blocks(seen(1.0, 0.2, standing=2.5), PLAN)
    rule = GapRequirement(gap=4.0, least=2.0, post_clear=1.0)
    # A rule's gap is never waited out: who stands near its zone blocks for as long as it stands.
    near = seen(-3.0, 0.0, standing=30.0, source="wc")
    assert near.to_zone < 8.0
    assert rule.blocks(near, PLAN)
    assert not rule.blocks(seen(-30.0, 0.0, standing=30.0, source="wc"), PLAN)


def test_one_who_has_cleared_the_zone_in_time_is_not_in_the_way() -> None:
    gone = seen(0.0, 10.0, source="wc")
    end = gone.zone.b_out + 4.5
    rule = GapRequirement(gap=4.0, least=2.0, post_clear=1.0)
    assert not rule.blocks(seen(end - 4.0, 10.0, source="wc"), PLAN)
    assert rule.blocks(seen(end - 12.0, 10.0, source="wc"), PLAN)
