"""`idm-e` before a crossing, in a closed loop without SUMO; `idm` for comparison."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from labelled import CASES
from planner_loop import Body, World, constant, verdict

from tsbench.geometry.polyline import Polyline
from tsbench.planners.experts.expert import Expert
from tsbench.planners.idm import Idm
from tsbench.roads.lane_graph import Destination
from tsbench.roads.network import RoadNetwork, read_network
from tsbench.signs.annotations import SignInstance
from tsbench.signs.rule_kinds import CrosswalkParams
from tsbench.sim.world import EGO_LENGTH_M, ActorKind

NETS = CASES / "nets"
CROSSING_X = 118.0
KERBS = {"right": -6.4, "left": 3.2}


@pytest.fixture(scope="module")
def network() -> RoadNetwork:
    return read_network(NETS / "crossing.net.xml")


def walker(name: str, side: str, from_kerb: float, speed: Callable[[float, World], float]) -> Body:
    """Somebody so far from the kerb on one side, who would walk straight over."""
    way = -1.0 if side == "left" else 1.0
    kerb = KERBS[side]
    track = Polyline([(120.5, kerb - way * 30.0), (120.5, kerb + way * 40.0)])
    return Body(name, (), 30.0 - from_kerb, speed, kind=ActorKind.PEDESTRIAN, length=0.3, width=0.5, track=track)


def world(network: RoadNetwork, *people: Body, lane: int = 0, speed: float = 8.0, before: float = 60.0) -> World:
    params = CrosswalkParams(":B_c0", "bc")
    sign = SignInstance("sign_0", "5.19", None, "ab", -1, 117.0, 117.0, -7.6, 0.0, "target", None, params)
    start = CROSSING_X - before - EGO_LENGTH_M / 2
    return World(network, f"ab_{lane}", start, speed, Destination("bc", 90.0), bodies=list(people), target=sign)


def setting_off(after: float, speed: float) -> Callable[[float, World], float]:
    return lambda time, _: speed if time >= after else 0.0


@pytest.mark.parametrize("side", KERBS)
@pytest.mark.parametrize("lane", [0, 1])
@pytest.mark.parametrize("start", [3.6, 7.75, 11.05])
@pytest.mark.parametrize("after", [1.0, 2.0, 3.0, 4.0, 5.0])
def test_lets_people_cross_whenever_they_set_off(
    network: RoadNetwork, side: str, lane: int, start: float, after: float
) -> None:
    people = [walker(f"p{k}", side, 3.0 + 4.2 * k, setting_off(after, 1.2)) for k in range(3)]
    driven = world(network, *people, lane=lane, speed=start).run(Expert(Idm()), 60.0)
    assert driven.arrived
    assert verdict(driven).compliant


def test_whoever_goes_by_what_is_in_the_way_does_not(network: RoadNetwork) -> None:
    driven = world(network, walker("p0", "left", 3.0, setting_off(2.0, 1.2))).run(Idm(), 60.0)
    assert driven.arrived
    assert [v.clause for v in verdict(driven).violations] == ["did_not_yield"]


def test_an_empty_crossing_costs_no_time(network: RoadNetwork) -> None:
    obedient, blind = world(network).run(Expert(Idm()), 60.0), world(network).run(Idm(), 60.0)
    assert len(obedient.states) == len(blind.states)
    assert not verdict(obedient).engaged


@pytest.mark.parametrize(("from_kerb", "speed", "least"), [(-8.0, 8.0, 7.0), (20.0, 11.0, 9.0)])
def test_passes_behind_one_who_walks_away_and_before_one_who_is_far_away(
    network: RoadNetwork, from_kerb: float, speed: float, least: float
) -> None:
    driven = world(network, walker("p0", "right", from_kerb, constant(1.2)), speed=speed).run(Expert(Idm()), 60.0)
    assert driven.arrived
    assert min(e.speed for e in driven.states) > least
    assert verdict(driven).compliant


def test_does_not_wait_for_ever_for_one_who_stands_at_the_kerb(network: RoadNetwork) -> None:
    driven = world(network, walker("p0", "right", 1.0, constant(0.0))).run(Expert(Idm()), 60.0)
    stood = sum(e.speed < 0.3 for e in driven.states) * 0.1
    assert driven.arrived
    assert 3.0 < stood < 15.0
    assert not verdict(driven).engaged


def test_stops_short_of_the_crossing(network: RoadNetwork) -> None:
    driven = world(network, walker("p0", "right", -1.0, constant(0.0))).run(Expert(Idm()), 40.0)
    assert not driven.arrived
    assert 0.3 <= CROSSING_X - (driven.ego.x + EGO_LENGTH_M / 2) <= 2.5
    assert verdict(driven).compliant
