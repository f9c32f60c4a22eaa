"""How scenes of prohibited and prescribed ways are arranged, on crossroads made by hand."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from pool_builders import Networks, dual_path, halves_of, prepared, recipe_of, scene_task, signed_half
from simworld import CALM, edge, plain

from tsbench.make.maps.plain import PlainNet, PlainNode
from tsbench.make.placements.by_name import placement_of
from tsbench.make.placements.obedient_way import drive_time, grazing_turns, sharpest_bend, waits
from tsbench.make.placements.placement import Arrangement, SceneTask, UnfitMapError
from tsbench.make.scenes.recipe import Variant
from tsbench.make.scenes.traffic import Router, TrafficRequest, standing_cars
from tsbench.roads.lane_graph import LaneGraph
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.catalog import load_catalog
from tsbench.signs.rule_kinds import JunctionParams
from tsbench.sim.world import EGO_LENGTH_M

LAYOUTS = range(6)
TOWARDS = {"s": np.array([1.0, 0.0]), "l": np.array([0.0, 1.0]), "r": np.array([0.0, -1.0])}
# Type: (slot, shape) of its map here.
TYPES = {
    "no_turn_right": ("r_s", "X"), "no_turn_left": ("l_s", "X"), "direction_straight": ("r_s", "X"),
    "direction_right": ("s_r", "X"), "direction_left": ("s_l", "T"), "direction_straight_right": ("l_r", "X"),
    "direction_straight_left": ("r_s", "X"), "direction_left_right": ("s_l", "X"), "one_way_right": ("l_r", "T"),
    "one_way_left": ("r_s", "X"), "no_entry": ("l_s", "X", 40.0),
}  # fmt: skip


def ways(slot: str, shape: str, longer_m: float = 0.0) -> tuple[PoolRow, PlainNet]:
    """From a to b; on by p to d, or by q and round to p. On an X the third arm ends at t. longer_m: of both exits."""
    first, second = TOWARDS[slot[0]], TOWARDS[slot[2]]
    p, q = (50.0 + longer_m) * first, (30.0 + longer_m) * second
    aside = np.array([30.0, 0.0]) if slot in ("l_r", "r_l") else p
    around = [q + aside, p + aside] if slot in ("l_r", "r_l") else [q + aside]
    places = {"a": (-100.0, 0.0), "b": (0.0, 0.0), "p": p, "q": q, "d": p + 60.0 * first}
    corners = [f"u{k}" for k in range(len(around))]
    places |= dict(zip(corners, around, strict=True))
    pairs = [("a", "b"), ("b", "p"), ("p", "d"), *pairwise(["b", "q", *corners, "p"])]
    if shape == "X":
        places["t"] = 60.0 * next(v for k, v in TOWARDS.items() if k not in slot)
        pairs.append(("b", "t"))
    n = {k: PlainNode(k, float(x), float(y)) for k, (x, y) in places.items()}
    # The longer way's last road runs one way: who turns into it from the short way would have to be let go first.
    edges = [edge(n[i], n[j]) for x, y in pairs for i, j in ((x, y), (y, x)) if (i, j) != ("p", corners[-1])]
    row = dual_path(
        signed_edge="ab", start_edge="ab", junction="b", destination_edge="pd", short=["bp", "pd"],
        compliant=[*(i + j for i, j in pairwise(["b", "q", *corners, "p"])), "pd"],
    )  # fmt: skip
    return replace(row, slot=slot, shape=shape), plain(list(n.values()), edges)


MAPS = {type_id: ways(*key) for type_id, key in TYPES.items()}


def task_of(networks: Networks, type_id: str, layout: int = 0, **change: str) -> SceneTask:
    row = replace(MAPS[type_id][0], **change)
    variant = Variant(1, 90.0, 4.0, 7.75, 0, layout, plate=layout)
    return scene_task(row, networks[type_id], recipe_of(type_id), variant, seed=layout)


def place(networks: Networks, type_id: str, layout: int = 0, **change: str) -> Arrangement:
    return signed_half(task_of(networks, type_id, layout, **change))


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("type_id", TYPES)
def test_navigation_leads_into_what_the_plate_prohibits(networks: Networks, type_id: str, layout: int) -> None:
    network, recipe = networks[type_id], recipe_of(type_id)
    a, graph = place(networks, type_id, layout), LaneGraph(networks[type_id])
    row = MAPS[type_id][0]
    assert a.route_hint == ("ab", *row.fields["short"]) == graph.route("ab", "pd")
    assert a.compliant_hint == ("ab", *row.fields["compliant"])
    lane = network.lane(a.start.lane)
    before = lane.line.length - a.start.s - EGO_LENGTH_M / 2
    assert recipe.number("ego_nearest_m") <= before <= recipe.number("ego_farthest_m")
    allowed = load_catalog().sign(a.signs[0].code).rule.options.get("allowed")
    turns = {x: graph.turn("ab", x) for x in graph.successors("ab")}
    if allowed is not None:
        assert turns["bp"] not in allowed
        assert turns["bq"] in allowed
        # No other car makes any of the turns that the plate prohibits.
        assert {("ab", x) for x, turn in turns.items() if turn not in allowed} <= a.avoid_turns


@pytest.mark.parametrize("type_id", sorted(set(TYPES) - {"no_entry"}))
def test_the_plate_stands_before_the_junction(networks: Networks, type_id: str) -> None:
    sign = place(networks, type_id).signs[0]
    line = networks[type_id].edge_lanes("ab")[0].line
    assert (sign.edge, sign.params) == ("ab", JunctionParams("ab", "b"))
    assert sign.position_m == pytest.approx(line.length - recipe_of(type_id).number("plate_before_line_m"))
    assert (sign.code,) == load_catalog().type(type_id).codes


@pytest.mark.parametrize("type_id", sorted(set(TYPES) - {"no_entry"}))
def test_the_contrast_plate_can_stand_there(networks: Networks, type_id: str) -> None:
    """5.7.x only on both halves of one-way types; elsewhere, where some plates permit a common way, these."""
    permitted = []
    for layout in LAYOUTS:
        task = task_of(networks, type_id, layout)
        signed, contrast = halves_of(task)
        code = contrast.signs[0].code
        assert code.startswith("5.7") == type_id.startswith("one_way")
        assert code != signed.signs[0].code
        both = [set(load_catalog().sign(c).rule.options["allowed"]) for c in (signed.signs[0].code, code)]
        there = {task.graph.turn("ab", e) for e in task.graph.successors("ab")} - {"u_turn"}
        permitted.append(bool(set.intersection(*both, there)))
    assert all(permitted) or not any(permitted)


@pytest.mark.parametrize("type_id", TYPES)
def test_others_never_do_what_the_plate_prohibits(networks: Networks, type_id: str) -> None:
    a, network = place(networks, type_id), networks[type_id]
    graph, rng = LaneGraph(network), np.random.default_rng(3)
    ask = TrafficRequest(
        40.0, (CALM,) * 12, a.start, a.avoid_turns, a.quiet_edges, a.blocked, a.platoons, a.closed_edges
    )
    router = Router(graph, a.avoid_turns)
    routes = [router.walk(e, rng) for e in network.edges if not network.edges[e].internal for _ in range(20)]
    routes += [car.edges for car in standing_cars(network, graph, ask, rng)]
    turns = {turn for route in routes for turn in pairwise(route)}
    closed = type_id in ("no_entry", "one_way_right", "one_way_left")
    assert not turns & a.avoid_turns
    assert ("ab", "bp") not in turns
    # A closed edge is empty from all sides; a prohibited turn still leaves it to the other arms.
    into = {(e, "bp") for e in network.edges if "bp" in graph.successors(e)} - a.avoid_turns
    assert any(b == "bp" for _, b in turns) == bool(into)
    assert not (into and closed)
    ways = {a.route_hint[1], a.compliant_hint[1]}
    if type_id.startswith("one_way"):
        arm = "q" if type_id == "one_way_right" else "t"
        ways = {"bp", "pb", f"b{arm}", f"{arm}b"}
    # Where the ways bend on the spot, cars on the way back would cut the ego's corner.
    grazing = grazing_turns(graph, a.route_hint) | grazing_turns(graph, a.compliant_hint)
    assert grazing <= a.avoid_turns
    assert a.closed_edges - (ways if closed else set()) <= {edge for edge, _ in grazing}
    assert not closed or ways <= a.closed_edges


@pytest.mark.parametrize("type_id", TYPES)
def test_on_either_way_nobody_goes_first(networks: Networks, type_id: str) -> None:
    network, a = networks[type_id], place(networks, type_id)
    graph = LaneGraph(network)
    for way in (a.route_hint, a.compliant_hint):
        assert not any(waits(graph, x, y, a.avoid_turns) for x, y in pairwise(way))


@pytest.mark.parametrize("type_id", TYPES)
def test_nobody_waits_on_the_obedient_way_for_a_turn(networks: Networks, type_id: str) -> None:
    a, graph = place(networks, type_id), LaneGraph(networks[type_id])
    for here in a.compliant_hint[:-1]:
        turns = {(here, x) for x in graph.successors(here)} - a.avoid_turns
        assert not any(waits(graph, *t, a.avoid_turns) for t in turns)


def test_no_entry_stands_on_the_closed_edge(networks: Networks) -> None:
    a, recipe = place(networks, "no_entry"), recipe_of("no_entry")
    sign = a.signs[0]
    assert (sign.code, sign.edge) == ("3.1", "bp")
    assert sign.position_m == recipe.number("plate_after_start_m")
    graph = LaneGraph(networks["no_entry"])
    into = {(e, "bp") for e in networks["no_entry"].edges if "bp" in graph.successors(e)}
    assert len(into) == 3
    assert into <= a.avoid_turns


@pytest.mark.parametrize("type_id", ["one_way_right", "one_way_left"])
def test_the_crossing_road_has_both_directions(networks: Networks, type_id: str) -> None:
    """Which way it runs, only the plate says."""
    arm = "q" if type_id == "one_way_right" else "t"
    assert {f"b{arm}", f"{arm}b", "bp", "pb"} <= set(networks[type_id].edges)


def test_a_one_way_road_has_to_go_on() -> None:
    row, crop = ways("l_s", "X")
    without = replace(crop, edges=tuple(e for e in crop.edges if e.id != "bt"))
    recipe = recipe_of("one_way_right")
    with pytest.raises(UnfitMapError, match="does not go on where the plate points"):
        placement_of(recipe).prepare(row, without, recipe)


def test_a_road_of_two_lanes_is_not_sent_into_one_of_one(networks: Networks, tmp_path: Path) -> None:
    row, crop = ways(*TYPES["no_turn_left"])
    wide = replace(crop, edges=tuple(replace(e, num_lanes=2) if e.id == "ab" else e for e in crop.edges))
    network = prepared(tmp_path, "no_turn_left", row, wide)
    with pytest.raises(UnfitMapError, match="a plate would send 2 lanes of a road into one of 1"):
        place(networks | {"no_turn_left": network}, "no_turn_left")


def test_a_way_in_another_direction_than_its_slot_is_unfit(networks: Networks) -> None:
    with pytest.raises(UnfitMapError, match="slot r_s, but the way over bp goes left"):
        place(networks, "no_turn_left", slot="r_s")


def test_a_way_on_which_others_go_first_is_unfit(networks: Networks, monkeypatch: pytest.MonkeyPatch) -> None:
    network = networks["no_turn_left"]
    lanes = network.lanes
    first = next(c.via[0] for c in network.connections if c.state == "M" and lanes[c.from_lane].edge == "bq")
    other = tuple(
        replace(c, yields_to=frozenset({first})) if lanes[c.from_lane].edge == "qu0" else c for c in network.connections
    )
    monkeypatch.setitem(networks, "no_turn_left", replace(network, connections=other))
    with pytest.raises(UnfitMapError, match="others go first on the obedient way at the end of qu0"):
        place(networks, "no_turn_left")


def test_a_turn_that_sumo_calls_by_another_name_is_unfit(networks: Networks, monkeypatch: pytest.MonkeyPatch) -> None:
    network = networks["no_turn_left"]
    other = tuple(replace(c, direction="s" if c.direction == "r" else c.direction) for c in network.connections)
    monkeypatch.setitem(networks, "no_turn_left", replace(network, connections=other))
    with pytest.raises(UnfitMapError, match="SUMO calls the turn into bt 's', by its angle it is right"):
        place(networks, "no_turn_left")


def test_a_way_that_takes_too_long_is_unfit_before_anything_is_built() -> None:
    row, crop = ways("l_s", "X")
    recipe = recipe_of("no_turn_left")
    seconds = drive_time(crop, ("ab", *row.fields["compliant"]), recipe)
    # 60 m, three edges of 30, 50 and 30 m and 20 m at 9.5 m/s; two left turns and one right.
    assert seconds == pytest.approx((60 + 30 + 50 + 30 + 20) / 9.5 + 3 * 3.0)
    tight = replace(recipe, numbers=recipe.numbers | {"longest_drive_s": seconds - 1.0})
    with pytest.raises(UnfitMapError, match="the obedient way takes about 29 s"):
        placement_of(tight).prepare(row, crop, tight)


@pytest.mark.parametrize(("degrees", "sharp"), [(50.0, False), (-40.0, False), (90.0, True), (-100.0, True)])
def test_a_way_with_a_kink_in_a_road_is_unfit(degrees: float, sharp: bool) -> None:
    row, crop = ways("l_s", "X")
    by_id = {e.id: e for e in crop.edges}
    (x, y), end = by_id["qu0"].shape
    # Half of the way up beside the straight line, so that the two legs part by so many degrees.
    corner = (x - 25.0 * float(np.tan(np.radians(degrees / 2))), y + 25.0)
    bent = replace(by_id["qu0"], shape=((x, y), corner, end))
    found = sharpest_bend(bent)
    assert found == pytest.approx(abs(degrees))
    assert (found > recipe_of("no_turn_left").number("sharpest_bend_deg")) is sharp
    crop = replace(crop, edges=tuple(bent if e.id == "qu0" else e for e in crop.edges))
    recipe = recipe_of("no_turn_left")
    if sharp:
        with pytest.raises(UnfitMapError, match=f"bends by {found:.0f} degrees in a road"):
            placement_of(recipe).prepare(row, crop, recipe)
    else:
        placement_of(recipe).prepare(row, crop, recipe)
