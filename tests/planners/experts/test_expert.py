"""`idm-e` in a closed loop on small nets: one block per rule."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest
from planner_loop import KMH, Body, World, car, constant, front_of, load, target_plate, to_line, touched, verdict

from tsbench.core.errors import InputError
from tsbench.geometry.footprint import boxes_overlap
from tsbench.planners.base import Control, PlannerContext
from tsbench.planners.experts.expert import Expert
from tsbench.planners.idm import Idm
from tsbench.planners.observation import Observation, SignView
from tsbench.roads.lane_graph import Destination
from tsbench.roads.network import RoadNetwork
from tsbench.signs.annotations import SignInstance
from tsbench.sim.scene import Obstacle
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M

# --- give way ---

YIELD = target_plate("2.4", "sc", junction="c", approach="sc", main_in="wc ec")


def junction(network: RoadNetwork, target: str, bodies: list[Body], speed: float = 8.0) -> World:
    lane = network.lane("sc_0").line.length
    return World(network, "sc_0", lane - 62.0, speed, Destination(target, 60.0), bodies=bodies, target=YIELD)


def test_goes_through_without_a_stop_where_nobody_comes() -> None:
    world = junction(load("cross"), "cn", []).run(Expert(Idm()), 40.0)
    assert world.arrived
    assert min(e.speed for e in world.states) > 7.0


@pytest.mark.parametrize("target", ["cn", "cw", "ce"])
@pytest.mark.parametrize("before", [5.0, 20.0, 40.0, 60.0, 80.0, 100.0])
@pytest.mark.parametrize("speed", [5.0, 8.0, 13.0])
def test_lets_pass_who_comes(target: str, before: float, speed: float) -> None:
    network = load("cross")
    vehicles = [
        car(network, "wc", "ce", before, constant(speed)),
        car(network, "ec", "cw", before + 15.0, constant(speed)),
    ]
    world = junction(network, target, vehicles).run(Expert(Idm()), 60.0)
    assert world.arrived
    assert not touched(world)
    assert verdict(world).compliant


def test_stops_before_the_line_while_it_waits() -> None:
    network = load("cross")
    stream = [car(network, "wc", "ce", 40.0 + 16.0 * k, constant(7.0)) for k in range(5)]
    world = junction(network, "cn", stream).run(Expert(Idm()), 60.0)
    assert world.arrived
    standing = [d for d, e in zip(to_line(world), world.states, strict=True) if e.speed < 0.05]
    assert standing
    assert 0.7 < min(standing) < 3.0
    assert min(c.acceleration for c in world.controls) > -3.0


@pytest.mark.parametrize("away", [12.0, 20.0, 30.0, 40.0])
@pytest.mark.parametrize("nearest", [12.0, 20.0, 30.0, 45.0])
@pytest.mark.parametrize("speed", [3.6, 7.75, 11.05])
def test_a_held_convoy_is_neither_waited_for_for_ever_nor_dashed_in_front_of(
    away: float, nearest: float, speed: float
) -> None:
    network = load("cross")

    def held(t: float, w: World) -> float:
        if not hasattr(w, "let") and to_line(w)[-1] <= nearest:
            w.let = t
        return min(2.0 * (t - w.let), 7.0) if hasattr(w, "let") else 0.0

    convoy = [car(network, "wc", "ce", away + gap, held) for gap in (0.0, 9.5)]
    world = junction(network, "cn", convoy, speed).run(Expert(Idm()), 60.0)
    assert world.arrived
    assert not touched(world)
    assert verdict(world).compliant


@pytest.mark.parametrize(
    ("way", "lane", "exit", "away", "within_s"), [("cn", "wc", "ce", 30.0, 60.0), ("ce", "nc", "cs", 20.0, 20.0)]
)
def test_one_who_stands_far_away_or_has_no_priority_is_passed_in_the_end(
    way: str, lane: str, exit: str, away: float, within_s: float
) -> None:
    network = load("cross")
    world = junction(network, way, [car(network, lane, exit, away, constant(0.0))]).run(Expert(Idm()), within_s)
    assert world.arrived


# --- speed ---


@pytest.mark.parametrize("ends", [True, False])
@pytest.mark.parametrize("limit", [20.0, 30.0, 40.0])
def test_is_slow_enough_at_the_plate_and_until_the_end_plate(limit: float, ends: bool) -> None:
    network = load("long")
    v, v0 = limit / KMH, limit / KMH + 8.0
    line, end = 200.0, 300.0
    start = line - ((v0 * v0 - v * v) / 7.0 + 0.5 * v0 + 3.0) - EGO_LENGTH_M / 2
    plate = SignView("3.25", limit, 0.0, 0.0, 0.0, "ab", -1, end, 10.0)
    world = World(
        network, "ab_0", start, v0, Destination("ab", 400.0), signs=(plate,) if ends else (),
        target=target_plate("3.24", "ab", limit, line, zone_edges="ab"),
    ).run(Expert(Idm()), 90.0)  # fmt: skip
    assert world.arrived
    inside = [e.speed * KMH for e in world.states if line < front_of(e) < end]
    behind = [e.speed * KMH for e in world.states if front_of(e) > end + 20.0]
    assert limit - 3.0 < min(inside) <= max(inside) <= limit
    assert (max(behind) > limit + 3.0) is ends
    assert verdict(world).compliant is not ends
    assert min(c.acceleration for c in world.controls) > -4.0


# --- detour ---


def detour(
    bodies: list[Body],
    speed: float = 11.0,
    code: str = "4.2.1",
    lane: str = "ab_1",
    more: tuple[SignInstance, ...] = (),
) -> World:
    network = load("corridor")
    x, y = network.lane(lane).line.point_at(100.0)
    island = Obstacle("obstacle_0", "island", x, y, network.lane(lane).line.heading_at(100.0), 5.0, 1.5, lane)
    near = 97.5
    return World(
        network, lane, near - 60.0 - EGO_LENGTH_M / 2, speed, Destination("ab", 190.0), bodies=bodies,
        obstacles=(island,), target=target_plate(code, "ab", None, near, obstacle="obstacle_0"), more_targets=more,
    )  # fmt: skip


def passes_clear(world: World, side: str) -> bool:
    o = world.obstacles[0]
    for ego in world.states:
        box = (o.x, o.y, o.heading, o.length, o.width)
        assert not boxes_overlap(ego.x, ego.y, ego.heading, EGO_LENGTH_M, EGO_WIDTH_M, *box)
        if abs(ego.x - o.x) < 4.0 and (ego.y > o.y) != (side == "left"):
            return False
    return world.arrived


@pytest.mark.parametrize("speed", [3.6, 7.75, 11.05, 16.0])
def test_passes_the_obstacle_on_the_allowed_side(speed: float) -> None:
    right = detour([], speed).run(Expert(Idm()), 60.0)
    assert passes_clear(right, "right")
    assert min(e.speed for e in right.states) > min(speed, 5.0) - 0.5
    left = detour([], speed, "4.2.2", "ab_0").run(Expert(Idm()), 60.0)
    assert passes_clear(left, "left")


@pytest.mark.parametrize(("speed", "start"), [(8.0, 12.0), (4.0, 0.0), (8.0, 0.0)])
def test_waits_for_a_gap_in_the_lane_beside(speed: float, start: float) -> None:
    queue = [
        Body(f"q{k}", ("ab_0", "bd_0"), 25.0 + 12.0 * k, lambda t, _: speed if t >= start else 0.0) for k in range(7)
    ]
    world = detour(queue, 8.0).run(Expert(Idm()), 60.0)
    assert passes_clear(world, "right")
    assert verdict(world).compliant
    assert not touched(world)


def test_never_leaves_its_lane_beside_somebody() -> None:
    beside = Body("b", ("ab_0", "bd_0"), 40.0, lambda t, w: w.ego.speed if t < 5.0 else 14.0)
    world = detour([beside], 8.0).run(Expert(Idm()), 60.0)
    assert passes_clear(world, "right")
    assert not touched(world)


# --- manoeuvre ---


def test_takes_the_compliant_branch_and_is_not_led_back() -> None:
    network = load("cross")
    rule = target_plate("3.18.2", "ec", junction="c", approach="ec")
    world = World(network, "ec_0", 60.0, 8.0, Destination("cs", 60.0), target=rule)
    # Left from `ec` is `cs`; the other way to it leads round by the north-west corner and `nc`.
    world.run(Expert(Idm()), 120.0)
    driven = [network.lanes[e.lane].edge for e in world.states if e.lane >= 0]
    assert ("ec", "cs") not in list(pairwise(driven))
    assert world.arrived
    assert verdict(world).compliant
    blind = World(network, "ec_0", 60.0, 8.0, Destination("cs", 60.0)).run(Idm(), 60.0)
    assert blind.arrived
    assert blind.time < world.time


def test_says_so_where_no_way_is_allowed() -> None:
    network = load("corridor")
    rule = target_plate("4.1.2", "ab", junction="b", approach="ab")
    with pytest.raises(InputError, match="no way to edge 'bd'"):
        World(network, "ab_0", 60.0, 8.0, Destination("bd", 60.0), target=rule).run(Expert(Idm()), 1.0)


# --- the wrapper ---


class Stubborn:
    """A base that has no route: full speed ahead."""

    def reset(self, context: PlannerContext) -> None:
        assert context.privilege is None

    def act(self, observation: Observation) -> Control:
        return Control(3.0, 0.0)


def test_holds_any_base_at_the_line_and_within_the_limit() -> None:
    network = load("cross")
    vehicles = [car(network, "wc", "ce", 3.0, constant(0.0))]
    world = junction(network, "cn", vehicles).run(Expert(Stubborn()), 15.0)
    assert to_line(world)[-1] > 0.7
    limit = target_plate("3.24", "sc", 30.0, 60.0, zone_edges="sc")
    world = World(network, "sc_0", 5.0, 5.0, Destination("cn", 60.0), target=limit).run(Expert(Stubborn()), 30.0)
    assert max(e.speed for e in world.states if front_of(e) > 60.0 and e.s > 60.0) * KMH <= 30.0


def test_leads_a_base_that_has_its_own_way() -> None:
    rule_world = detour([], 8.0).run(Expert(Stubborn()), 30.0)
    assert passes_clear(rule_world, "right")


def test_needs_its_plate() -> None:
    network = load("corridor")
    with pytest.raises(InputError, match="privilege"):
        World(network, "ab_0", 60.0, 8.0, Destination("bd", 60.0)).run(Expert(Idm()), 1.0)


# --- junctions without a sign ---


def test_gives_way_at_other_junctions_as_the_network_has_it() -> None:
    network = load("cross")
    rule = target_plate("3.18.2", "nne", junction="ne", approach="nne")
    stream = [car(network, "wc", "ce", 20.0 + 12.0 * k, constant(7.0)) for k in range(5)]
    world = World(network, "sc_0", 60.0, 8.0, Destination("cn", 60.0), bodies=stream, target=rule)
    world.run(Expert(Idm()), 60.0)
    assert world.arrived
    assert not touched(world)
    assert min(e.speed for e in world.states) < 0.5
    onto = World(network, "wc_0", 60.0, 8.0, Destination("ce", 60.0), target=rule)
    assert min(e.speed for e in onto.run(Expert(Idm()), 60.0).states) > 7.0


def test_keeps_a_limit_on_its_way_around_an_obstacle() -> None:
    limit = replace(target_plate("3.24", "ab", 30.0, 60.0, zone_edges="ab"), id="sign_1")
    free, limited = (detour([], more=more).run(Expert(Idm()), 60.0) for more in ((), (limit,)))
    assert free.arrived
    assert limited.arrived
    inside = [[e.speed * KMH for e in world.states if front_of(e) > 60.0] for world in (free, limited)]
    assert max(inside[0]) > 31.0 > 30.0 >= max(inside[1])
