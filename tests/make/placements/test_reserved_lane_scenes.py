"""How the four types of reserved lanes are arranged on roads made by hand, of one direction and of two."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from pool_builders import Networks, built_site, corridor, halves_of, recipe_of, row, scene_task, signed_half, two_way
from simworld import CALM, LIMIT, edge, loader_of, plain, simulation

from tsbench.make.maps.netconvert import build_net
from tsbench.make.maps.plain import PlainEdge, PlainNet, PlainNode
from tsbench.make.placements.by_name import placement_of
from tsbench.make.placements.placement import Arrangement, SceneTask, UnfitMapError, way_from_standstill
from tsbench.make.placements.reserved_lane_scenes import contra_id, turn_leftmost
from tsbench.make.scenes.recipe import Variant
from tsbench.make.scenes.verify import lint_scene
from tsbench.roads.lane_graph import LaneGraph
from tsbench.roads.network import read_network
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.annotations import DISTRACTOR, TARGET
from tsbench.signs.catalog import load_catalog
from tsbench.signs.contrast import ContrastClause, WayParams
from tsbench.sim.convoy import predicted_arrival
from tsbench.sim.ego import start_motion
from tsbench.sim.world import EGO_LENGTH_M

SAME, AGAINST = ("bus_lane", "bike_lane"), ("bus_lane_road", "bike_lane_road")
TYPES = (*SAME, *AGAINST)
LAYOUTS = range(6)


def fork(lanes_out: int = 3) -> tuple[PoolRow, PlainNet]:
    """A one-way road of three lanes from west to east, and a side road from the south that joins it at x."""
    places = {"w": (-142.0, 0.0), "x": (0.0, 0.0), "e": (142.0, 0.0), "s": (0.0, -90.0)}
    n = {k: PlainNode(k, x, y) for k, (x, y) in places.items()}
    ends = {"w_in": "wx", "e_out": "xe", "s_in": "sx", "s_out": "xs"}
    lanes = {"w_in": 3, "e_out": lanes_out, "s_in": 1, "s_out": 1}
    edges = [edge(n[a], n[b], lanes[name], name=name) for name, (a, b) in ends.items()]
    arms = [
        {"in_edge": into, "out_edge": out, "heading_deg": heading, "length_m": 142.0, "class": "secondary"}
        for into, out, heading in (("w_in", "", 180.0), ("", "e_out", 0.0), ("s_in", "s_out", -90.0))
    ]
    made = row("j-made-f", "junction", "T", node="x", arms=arms, through=[[0, 1]])
    return made, plain(list(n.values()), edges)


MAPS = {**dict.fromkeys(SAME, two_way(speed=LIMIT, length=250.0)), **dict.fromkeys(AGAINST, fork())}
WAYS = {**dict.fromkeys(SAME, ("road.0", "road.1")), **dict.fromkeys(AGAINST, ("w_in", "e_out"))}
TWO_WAY = two_way()[0]
WIDTH = 3.2


def users_of(type_id: str) -> str:
    return "bus" if type_id.startswith("bus") else "bicycle"


def task_of(networks: Networks, type_id: str, layout: int = 0, speed: float = 7.75, seed: int = 1) -> SceneTask:
    variant = Variant(1, (90.0, 120.0)[layout % 2], 4.0, speed, 0, layout)
    return scene_task(MAPS[type_id][0], networks[type_id], recipe_of(type_id), variant, seed)


def place(networks: Networks, type_id: str, layout: int = 0, speed: float = 7.75, seed: int = 1) -> Arrangement:
    return signed_half(task_of(networks, type_id, layout, speed, seed))


@pytest.mark.parametrize("type_id", TYPES)
@pytest.mark.parametrize("seed", range(6))
def test_the_ego_starts_before_the_plate_in_the_lane_that_it_reserves(
    networks: Networks, type_id: str, seed: int
) -> None:
    network, recipe = networks[type_id], recipe_of(type_id)
    a = place(networks, type_id, seed, seed=seed)
    sign = a.signs[0]
    lane = network.lane(a.start.lane)
    approach, zone = WAYS[type_id]
    assert lane.edge == approach == sign.params.approach
    assert lane.order == (0 if type_id in SAME else len(network.edges[approach].lanes) - 1)
    before = lane.line.length - a.start.s - EGO_LENGTH_M / 2
    assert recipe.number("run_up_least_m") <= before <= recipe.number("run_up_most_m")
    after = recipe.numbers.get("plate_after_junction_m", 0.0)
    assert (sign.edge, sign.position_m, sign.params.zone_edges) == (zone, after, (zone,))
    reserved = network.lane(*sign.params.lanes)
    assert reserved.line.length >= recipe.number("zone_least_m") - 5.0
    # Its users may, other cars may not.
    assert reserved.permits(users_of(type_id))
    assert not reserved.permits("passenger")
    others = [i for i in network.edge_lanes(zone) if i.id != reserved.id]
    assert all(i.permits("passenger") for i in others)
    assert (lane.id, a.start.s, lane.line.length) in a.blocked
    assert a.destination.s < network.edge_lanes(a.destination.edge)[0].line.length - 7.0


@pytest.mark.parametrize("type_id", TYPES)
def test_navigation_leads_through_the_reserved_lane(networks: Networks, type_id: str) -> None:
    network, a = networks[type_id], place(networks, type_id)
    graph, start = LaneGraph(network), network.lane(a.start.lane)
    assert a.route_hint == graph.route(start.edge, a.destination.edge)
    path = graph.path(a.route_hint, start.index, a.start.s, a.destination)
    assert path is not None
    reserved = network.lane(*a.signs[0].params.lanes)
    assert reserved.index in {p.lane for p in path.pieces}
    # It keeps to one line: never as much as a metre to either side.
    offsets = [start.line.project(*p)[1] for p in path.line.points.tolist()]
    assert max(map(abs, offsets)) < 0.1
    # An obedient way exists.
    other = LaneGraph(network, closed={reserved.index})
    assert other.path(a.route_hint, start.index, a.start.s, a.destination) is not None


@pytest.mark.parametrize("type_id", SAME)
def test_behind_the_zone_the_lane_is_everybodys(networks: Networks, type_id: str) -> None:
    network, a = networks[type_id], place(networks, type_id)
    reserved = network.lane("road.1_0")
    assert a.signs[0].params.lanes == (reserved.id,)
    assert network.lane("road.2_0").permits("passenger")
    assert [network.lanes[c.to_lane].id for c in network.outgoing[reserved.index]] == ["road.2_0"]
    assert a.destination.edge == "road.2"


@pytest.mark.parametrize("type_id", AGAINST)
def test_the_leftmost_lane_is_an_edge_of_its_own_the_other_way_round(networks: Networks, type_id: str) -> None:
    network = networks[type_id]
    turned, zone, first = (network.edges[name] for name in (contra_id("e_out"), "e_out", "w_in"))
    assert (turned.source, turned.target) == (zone.target, zone.source)
    assert (len(first.lanes), len(zone.lanes), len(turned.lanes)) == (3, 2, 1)
    lane, leftmost = network.edge_lanes(turned.id)[0], network.edge_lanes("w_in")[-1]
    assert lane.line.points[0][0] > lane.line.points[-1][0]
    # The leftmost lane leads nowhere but into the turned one, as a map has it.
    assert network.outgoing[leftmost.index] == ()
    assert leftmost.line.points[-1][1] == pytest.approx(lane.line.points[-1][1], abs=0.5)
    for a, b in zip(network.edge_lanes("w_in"), network.edge_lanes("e_out"), strict=False):
        assert [c.to_lane for c in network.outgoing[a.index]] == [b.index]


@pytest.mark.parametrize("spread", ["right", "center"])
def test_a_bent_road_stays_where_it_was(tmp_path: Path, spread: str) -> None:
    """Whatever its shape is drawn along, each lane lies where it lay before it was turned."""
    shape = ((0.0, 0.0), (60.0, 0.0), (110.0, 14.0), (160.0, 38.0))
    nodes = (PlainNode("a", 0.0, 0.0), PlainNode("b", 160.0, 38.0))
    edge = PlainEdge("e", "a", "b", 3, LIMIT, 5, shape, width=3.5, spread=spread)
    whole = PlainNet(nodes, (edge,), ())
    build_net(whole, tmp_path / "whole.net.xml")
    build_net(turn_leftmost(whole, "e", "e.contra", "bus"), tmp_path / "turned.net.xml")
    before, after = read_network(tmp_path / "whole.net.xml"), read_network(tmp_path / "turned.net.xml")
    now = [*after.edge_lanes("e"), *after.edge_lanes("e.contra")]
    for old, new in zip(before.edge_lanes("e"), now, strict=True):
        assert new.width == old.width == 3.5
        for x, y in new.line.resampled(5.0).points.tolist():
            assert abs(old.line.project(x, y)[1]) < 0.05


@pytest.mark.parametrize("type_id", AGAINST)
@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("speed", [3.61, 7.75, 11.05])
def test_users_meet_an_ego_that_stays_in_its_lane(networks: Networks, type_id: str, layout: int, speed: float) -> None:
    network, recipe = networks[type_id], recipe_of(type_id)
    a = place(networks, type_id, layout, speed, seed=layout)
    c = a.convoy
    lane, user = network.lane(c.lane), c.drivers[0]
    assert ((c.lane,), c.vclass) == (a.signs[0].params.lanes, users_of(type_id))
    # They drive on into the side road.
    assert c.edges == (contra_id("e_out"), "s_out")
    assert user.speed == recipe.number("user_speed_mps")
    assert (user.length, user.width) == (recipe.number("user_length_m"), recipe.number("user_width_m"))
    counts = recipe.choices["users"]
    assert 1 <= len(c.places) <= counts[layout % len(counts)]
    assert all(user.length < p < lane.line.length for p in c.places)
    # From front to front they keep the headway: the model's is that of the gap.
    assert user.headway + (user.length + user.gap) / user.speed == pytest.approx(recipe.number("user_headway_s"))
    start = network.lane(a.start.lane)
    across = math.dist(start.line.points[-1], lane.line.points[-1])
    meet = c.ego_zone_m - across
    assert 0.0 < meet <= recipe.number("meet_m")
    assert c.zone_m == pytest.approx(lane.line.length - meet)
    step = user.length + recipe.number("standing_gap_m")
    assert all(p - q == pytest.approx(step) for p, q in pairwise(c.places))
    # The lead is not so far away that it would come too late.
    to_line = start.line.length - a.start.s - EGO_LENGTH_M / 2
    eta = predicted_arrival(to_line, to_line + c.ego_zone_m, a.start.speed, start.speed, start.speed)
    assert c.zone_m - c.places[0] <= way_from_standstill(user, eta)
    assert (c.line_lane, c.ego_cruise_mps) == (a.start.lane, start.speed)


@pytest.mark.parametrize("type_id", SAME)
@pytest.mark.parametrize("layout", LAYOUTS)
def test_users_come_towards_the_ego_on_the_oncoming_lane_alone(networks: Networks, type_id: str, layout: int) -> None:
    network, recipe = networks[type_id], recipe_of(type_id)
    a = place(networks, type_id, layout, seed=layout)
    assert a.convoy is None
    users, types = ([e for e in a.extra if e.tag == tag] for tag in ("vehicle", "vType"))
    asked = recipe.choices["users"]
    assert [u.get("id") for u in users] == [f"user_{k}" for k in range(asked[layout % len(asked)])]
    assert {kind.get("vClass") for kind in types} == {users_of(type_id)}
    assert {(u[0].get("edges"), u.get("departLane")) for u in users} == {("back.1 back.2", "0")}
    fronts = [float(u.get("departPos", "nan")) for u in users]
    step = recipe.number("user_speed_mps") * recipe.number("user_headway_s")
    assert 0.0 <= fronts[0] - recipe.number("user_length_m") <= recipe.number("user_jitter_m")
    assert all(q - p == pytest.approx(step, abs=0.1) for p, q in pairwise(fronts))
    facing = network.edge_lanes("back.1")
    assert fronts[-1] < facing[0].line.length
    assert [lane.permits("passenger") for lane in facing] == [False, True]
    assert facing[0].permits(users_of(type_id))


@pytest.mark.parametrize("type_id", SAME)
def test_the_halves_exchange_the_plates_of_the_two_posts(networks: Networks, type_id: str) -> None:
    task = task_of(networks, type_id)
    placement, (signed, a) = placement_of(task.recipe), halves_of(task)
    # Nothing but the plates differs: neither the network nor the users.
    prepared = (make(*MAPS[type_id], task.recipe) for make in (placement.prepare, placement.prepare_contrast))
    assert next(prepared) == next(prepared)
    assert replace(a, signs=signed.signs, targets=signed.targets, contrast=()) == signed
    (reserved, usual), (first, second) = signed.signs, a.signs
    assert (reserved.code, usual.code, usual.value) == (*load_catalog().type(type_id).codes, "3.24", 50.0)
    assert (*signed.targets, *a.targets) == (reserved.id, usual.id)
    assert [s.role for s in (reserved, usual, first, second)] == [TARGET, DISTRACTOR, DISTRACTOR, TARGET]
    # The second post stands on the other side of the road, and faces oncoming traffic.
    assert (usual.edge, usual.position_m, abs(usual.heading)) == ("back.1", 0.0, pytest.approx(math.pi))
    assert usual.y > 0.0 > reserved.y
    assert reserved.x - usual.x == pytest.approx(task.recipe.number("facing_before_plate_m"), abs=0.1)
    hung = [(s.code, s.value, s.lane) for s in (reserved, usual, first, second)]
    assert hung[:2] == hung[:1:-1]
    assert [(s.x, s.y, s.heading) for s in signed.signs] == [(s.x, s.y, s.heading) for s in a.signs]
    assert a.contrast == (ContrastClause("needless_detour", WayParams("road.0", lanes=("road.1_0",))),)


def test_a_ramp_and_then_cruise_speed() -> None:
    user = replace(CALM, speed=8.0, accel=1.25)
    assert way_from_standstill(user, 4.0) == pytest.approx(8.0)
    assert way_from_standstill(user, 8.0) == pytest.approx(32.0)
    assert way_from_standstill(user, 10.0) == pytest.approx(48.0)


@pytest.mark.parametrize(
    ("type_id", "row", "back", "reason"),
    [
        ("bus_lane", replace(TWO_WAY, lanes=1), {}, "1 lanes"),
        ("bus_lane", corridor(lanes=2), {}, "no other direction, where the other half's plate faces"),
        ("bus_lane", TWO_WAY, {"num_lanes": 1}, "1 oncoming lanes"),
        ("bus_lane", TWO_WAY, {"shape": ((240.0, 0.0), (150.0, 0.0))}, "do not run side by side"),
        ("bike_lane", replace(TWO_WAY, length_m=140.0), {}, "60 m of road before the plate"),
    ],
)
def test_maps_that_cannot_carry_it(type_id: str, row: PoolRow, back: dict[str, Any], reason: str) -> None:
    """back: changes of the other direction's edge."""
    recipe, crop = recipe_of(type_id), two_way()[1]
    edges = (crop.edges[0], replace(crop.edges[1], **back))
    with pytest.raises(UnfitMapError, match=reason):
        placement_of(recipe).prepare(row, replace(crop, edges=edges), recipe)


def test_a_contraflow_lane_needs_an_exit_of_as_many_lanes_straight_ahead() -> None:
    recipe = recipe_of("bus_lane_road")
    with pytest.raises(UnfitMapError, match="no one-way exit lies straight ahead"):
        placement_of(recipe).prepare(*fork(lanes_out=2), recipe)


@pytest.mark.parametrize("type_id", TYPES)
def test_a_site_is_sound_and_its_users_are_there(type_id: str, tmp_path: Path) -> None:
    site = built_site(recipe_of(type_id), tmp_path, MAPS[type_id], lambda variants: variants[:2])
    assert site.reason == ""
    loader, sim = loader_of(tmp_path), simulation()
    for spec in site.rows:
        scene, roads = loader.load(spec)
        assert list(lint_scene(scene, roads.graph)) == []
        assert (scene.convoy is None) == (type_id in SAME)
        assert scene.convoy is None or 2.0 < scene.convoy.lead_time_s < 15.0
        # Variant 0 has no traffic, but users all the same.
        lane = scene.network.lane(scene.start.lane)
        sim.load_scene(scene)
        sim.start_ego(start_motion(scene), lane.edge, lane.order)
        user = ("user_0", "back.1_0") if type_id in SAME else ("convoy_0", f"{contra_id('e_out')}_0")
        assert user in [(name, on) for name, on, _ in sim.fleet()]


def test_a_road_whose_traffic_breaks_its_own_plate_is_unfit(tmp_path: Path) -> None:
    made = two_way("living_street", speed=LIMIT, length=250.0)  # no limit of its class is as high
    site = built_site(recipe_of("bike_lane"), tmp_path, made, lambda variants: variants[1:2])
    assert re.fullmatch(r"variant 1, 4 draws, at last: plate 3.24 is broken: \w+ drives \d+ km/h", site.reason)
