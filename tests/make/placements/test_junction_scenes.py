"""Who has priority at a junction, how its scenes are laid out, and that SUMO's right of way says the same."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from pool_builders import crossroads, prepared, recipe_of, scene_task, signed_half
from simworld import cross_plain

from tsbench.geometry.overlap import conflict_zone
from tsbench.make.maps.netconvert import build_net
from tsbench.make.maps.plain import PlainNet
from tsbench.make.placements.by_name import placement_of
from tsbench.make.placements.junction_priority import bending_arms, through_arms
from tsbench.make.placements.placement import Arrangement, SceneTask, UnfitMapError
from tsbench.make.scenes.recipe import Variant
from tsbench.roads.junction_paths import junction_path
from tsbench.roads.network import Connection, RoadNetwork, read_network
from tsbench.roads.planner_map import build_planner_map
from tsbench.scenarios.map_pool import PoolRow
from tsbench.sim.junction_traffic import HOLD_BEFORE_LINE_M, HOLD_BRAKE_MPS2
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M

TYPES = ("yield", "stop", "secondary_road", "main_road")
LAYOUTS = range(6)


def tee() -> tuple[PoolRow, PlainNet]:
    """The crossroads without its northern arm."""
    row, crop = crossroads("j-made-t"), cross_plain()
    fields = {**row.fields, "arms": [a for a in row.fields["arms"] if a["in_edge"] != "n_in"]}
    row = crossroads("j-made-t", arms=fields["arms"], through=[[0, 1]])
    return replace(row, shape="T"), replace(
        crop,
        nodes=tuple(n for n in crop.nodes if n.id != "n"),
        edges=tuple(e for e in crop.edges if e.id not in ("n_in", "n_out")),
    )


MAPS = {"X": (crossroads(), cross_plain()), "T": tee()}
Key = tuple[str, str]
Crossroads, Exchanged = dict[Key, RoadNetwork], dict[tuple[Key, float], RoadNetwork]
# On a T no opposite approach has the other half's plate of `secondary_road`.
KEYS: list[Key] = [(t, shape) for t in TYPES for shape in MAPS if (t, shape) != ("secondary_road", "T")]


@pytest.fixture(scope="module")
def networks(tmp_path_factory: pytest.TempPathFactory) -> Crossroads:
    """Each map as each type's placement prepares it."""
    folder = tmp_path_factory.mktemp("junctions")
    return {(type_id, shape): prepared(folder, type_id, *MAPS[shape]) for type_id, shape in KEYS}


def place(networks: Crossroads, key: Key, layout: int, seed: int = 1) -> Arrangement:
    return signed_half(task_of(networks[key], key, layout, seed))


def task_of(network: RoadNetwork, key: Key, layout: int, seed: int = 1, empty_share: float = 0.0) -> SceneTask:
    recipe = recipe_of(key[0])
    recipe = replace(recipe, numbers={**recipe.numbers, "empty_share": empty_share})
    return scene_task(MAPS[key[1]][0], network, recipe, Variant(1, 90.0, 4.0, 7.75, 0, layout), seed)


@pytest.fixture(scope="module")
def contrast_networks(tmp_path_factory: pytest.TempPathFactory) -> Exchanged:
    """Each map as the contrast half has it, by the share of maps on which nobody comes."""
    folder, built = tmp_path_factory.mktemp("contrasts"), {}
    for key in KEYS:
        for share in (0.0, 1.0) if key[0] == "stop" else (0.0,):
            row, crop = MAPS[key[1]]
            recipe = recipe_of(key[0])
            recipe = replace(recipe, numbers={**recipe.numbers, "empty_share": share})
            net = folder / f"{key[0]}{key[1]}{share}.net.xml.gz"
            build_net(placement_of(recipe).prepare_contrast(row, crop, recipe), net)
            built[key, share] = read_network(net)
    return built


def halves(
    networks: Crossroads, others: Exchanged, key: Key, layout: int, empty_share: float = 0.0
) -> tuple[Arrangement, Arrangement]:
    placement = placement_of(recipe_of(key[0]))
    signed = placement.place(task_of(networks[key], key, layout, empty_share=empty_share))
    task = task_of(others[key, empty_share], key, layout, empty_share=empty_share)
    other = placement.contrast(task, signed)
    assert other is not None
    return signed, other


def paths(network: RoadNetwork, a: Arrangement) -> tuple[Connection, Connection]:
    """The ego's connection and the convoy's."""
    convoy = a.convoy
    assert convoy is not None

    def link(lane: str, edge: str) -> Connection:
        own = network.outgoing[network.lane_index[lane]]
        return next(c for c in own if network.lanes[c.to_lane].edge == edge)

    return link(a.start.lane, a.destination.edge), link(convoy.lane, convoy.edges[1])


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("key", KEYS)
def test_the_convoy_meets_the_ego_and_sumo_lets_it_go_first(networks: Crossroads, key: Key, layout: int) -> None:
    network, recipe = networks[key], recipe_of(key[0])
    a = place(networks, key, layout)
    convoy, target = a.convoy, a.signs[0]
    assert convoy is not None
    lane = network.lane(a.start.lane)
    front = lane.line.length - a.start.s - EGO_LENGTH_M / 2
    assert front == pytest.approx(recipe.number("ego_before_line_m"))
    assert target.params.approach == lane.edge
    assert convoy.edges[0] in target.params.main_in
    ego, priority = paths(network, a)
    assert (ego.state in "ms", priority.state) == (True, "M")
    assert set(priority.via) & ego.yields_to
    assert not set(ego.via) & priority.yields_to
    own, other = junction_path(network, ego), junction_path(network, priority)
    zone = conflict_zone(own.onto_exit(15.0), EGO_WIDTH_M, other.onto_exit(15.0), other.width)
    assert convoy.ego_zone_m == pytest.approx(zone.a_in)
    priority_lane = network.lane(convoy.lane)
    assert convoy.zone_m == pytest.approx(priority_lane.line.length + zone.b_in)
    assert set(convoy.places) == {convoy.drivers[0].length}
    assert 1 <= len(convoy.places) == len(convoy.departs) <= recipe.number("convoy_most")
    assert list(convoy.departs) == sorted(set(convoy.departs))
    assert convoy.departs[0] > 0.0
    assert convoy.edges[0] in a.quiet_edges
    # Nobody is between the ego and its line.
    assert (lane.id, a.start.s, lane.line.length) in a.blocked


@pytest.mark.parametrize("key", KEYS)
def test_every_vehicle_with_priority_has_it_in_sumo_too(networks: Crossroads, key: Key) -> None:
    """All pairs of paths, not only the convoy's: where they conflict, those of `main_in` never wait for the ego's."""
    network = networks[key]
    params = place(networks, key, 0).signs[0].params
    egos = [c for i in network.edges[params.approach].lanes for c in network.outgoing[i]]
    with_priority = [c for e in params.main_in for i in network.edges[e].lanes for c in network.outgoing[i]]
    assert any(set(f.via) & c.yields_to for c in egos for f in with_priority)
    assert not any(set(c.via) & f.yields_to for c in egos for f in with_priority)


@pytest.mark.parametrize("key", KEYS)
def test_layouts_differ(networks: Crossroads, key: Key) -> None:
    scenes = [place(networks, key, layout) for layout in LAYOUTS]
    seen = {(a.destination.edge, a.convoy.edges) for a in scenes if a.convoy is not None}
    # Where a T's main road bends, the ego meets the other main arm on one of its ways only.
    assert len(seen) >= {"X": 4, "T": 3}[key[1]] - (key == ("main_road", "T"))


def test_the_main_road_is_the_through_pair_of_the_higher_class() -> None:
    arms = through_arms(crossroads(), 60.0)
    assert set(arms.prior_in) == {"w_in", "e_in"}
    assert (arms.ego_in, arms.minor_in, arms.bends) == ("s_in", ("n_in",), False)
    assert arms.main == {"w_in", "w_out", "e_in", "e_out"}
    with pytest.raises(UnfitMapError, match="the secondary arm is 142 m long"):
        through_arms(crossroads(), 150.0)
    with pytest.raises(UnfitMapError, match="no two arms go straight on"):
        through_arms(crossroads(through=[]), 60.0)


def test_a_main_road_that_bends_has_its_other_arm_on_the_right() -> None:
    right_of = {"s_in": "e_in", "e_in": "n_in", "n_in": "w_in", "w_in": "s_in"}
    seen = set()
    for k in range(60):
        arms = bending_arms(crossroads(f"j-{k}"), 60.0)
        assert arms.prior_in == (right_of[arms.ego_in],)
        assert set(arms.minor_in) == set(right_of) - {arms.ego_in, *arms.prior_in}
        seen.add(arms.ego_in)
    assert seen == set(right_of)  # all four bends are of the same classes here
    assert {bending_arms(replace(tee()[0], map_id=f"j-{k}"), 60.0).ego_in for k in range(60)} == {"s_in", "w_in"}
    with pytest.raises(UnfitMapError, match="no arm of 150 m has an arm to its right"):
        bending_arms(crossroads(), 150.0)


def test_a_main_road_bends_along_its_higher_class() -> None:
    arms = crossroads().fields["arms"]
    for one, other in (("s", "e"), ("w", "s")):
        better = [{**a, "class": "primary"} if a["in_edge"][0] in one + other else a for a in arms]
        chosen = bending_arms(crossroads(arms=better), 60.0)
        assert (chosen.ego_in, chosen.prior_in) == (f"{one}_in", (f"{other}_in",))


def test_plates_of_a_secondary_road_face_the_convoy_and_the_opposite_approach(networks: Crossroads) -> None:
    for layout in LAYOUTS:
        a = place(networks, ("secondary_road", "X"), layout)
        met = a.convoy.edges[0]
        assert [(s.code, s.edge, s.role) for s in a.signs] == [("2.3.1", met, "target"), ("2.4", "n_in", "distractor")]
        assert a.signs[1].params is None
        assert math.cos(a.signs[0].heading - {"w_in": 0.0, "e_in": math.pi}[met]) == pytest.approx(1.0)
        # The fourth arm has no plate, and no vehicle comes from there.
        assert a.closed_edges == {"w_in", "e_in"} - {met}


@pytest.mark.parametrize(("type_id", "code"), [("yield", "2.4"), ("stop", "2.5"), ("main_road", "2.1")])
def test_the_plate_stands_at_the_egos_line(networks: Crossroads, type_id: str, code: str) -> None:
    recipe = recipe_of(type_id)
    for shape in MAPS:
        a = place(networks, (type_id, shape), 0)
        end = networks[type_id, shape].lane(a.start.lane).line.length
        sign = a.signs[0]
        assert (sign.code, sign.edge) == (code, sign.params.approach)
        assert sign.position_m == pytest.approx(end - recipe.number("plate_before_line_m"))


def test_the_other_arms_of_a_bend_are_told_by_plates_that_bind_nobody_watched(networks: Crossroads) -> None:
    a = place(networks, ("main_road", "X"), 0)
    target, *others = a.signs
    told = {s.edge: s.code for s in others}
    [main_in] = target.params.main_in
    assert told.pop(main_in) == "2.1"
    assert set(told.values()) == {"2.4"}
    assert len(told) == 2
    assert all(s.params is None and s.role == "distractor" for s in others)


def test_a_car_waits_on_a_secondary_arm_now_and_then(networks: Crossroads) -> None:
    share = recipe_of("main_road").number("waiting_share")
    scenes = [place(networks, ("main_road", "X"), 0, seed) for seed in range(120)]
    waiting = [a.extra for a in scenes if a.extra]
    assert len(waiting) / len(scenes) == pytest.approx(share, abs=0.12)
    for _, vehicle in waiting:
        edge = str(vehicle[0].get("edges")).split()[0]
        assert edge not in (scenes[0].signs[0].edge, *scenes[0].signs[0].params.main_in)
    assert not any(place(networks, ("yield", "X"), 0, seed).extra for seed in range(20))


def test_nobody_turns_off_the_main_road_where_it_has_to_wait(networks: Crossroads) -> None:
    assert place(networks, ("yield", "X"), 0).avoid_turns == {("w_in", "n_out"), ("e_in", "s_out")}
    assert place(networks, ("yield", "T"), 0).avoid_turns == {("e_in", "s_out")}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_secondary_arms_that_would_go_before_the_ego(networks: Crossroads, layout: int) -> None:
    for type_id in TYPES:
        network, a = networks[type_id, "X"], place(networks, (type_id, "X"), layout)
        ego, _ = paths(network, a)
        first = {*a.signs[0].params.main_in, a.start.lane[:-2]}
        minor = {e for e in ("w_in", "e_in", "s_in", "n_in") if e not in first}
        before = {
            (e, network.lanes[c.to_lane].edge)
            for e in minor
            for i in network.edges[e].lanes
            for c in network.outgoing[i]
            if set(c.via) & ego.yields_to
        }
        if type_id == "main_road":
            # The plates give none of them priority: what SUMO sees otherwise, nobody does.
            assert before <= a.avoid_turns
        # Whom others let go first would tell what the plates say: nobody is at the junction before the ego.
        assert a.quiet_edges == {"w_in", "e_in", "s_in", "n_in"}
        assert a.quiet_s > 60.0 / 16.67


def test_all_minor_arms_stop_at_a_stop(networks: Crossroads) -> None:
    network = networks["stop", "X"]
    states = {e: {c.state for c in network.outgoing[network.edges[e].lanes[0]]} for e in ("s_in", "n_in")}
    assert states == {"s_in": {"s"}, "n_in": {"s"}}


def test_right_of_way_of_a_bend_goes_by_edges() -> None:
    recipe, (row, crop) = recipe_of("main_road"), MAPS["X"]
    prepared = placement_of(recipe).prepare(row, crop, recipe)
    assert {n.right_of_way for n in prepared.nodes if n.id == "x"} == {"edgePriority"}
    assert {n.right_of_way for n in prepared.nodes if n.id != "x"} == {""}


NEW_PLATES = {
    # The ego comes from the south; in the T of `main_road` the main road then leads from there to the west, or is the
    # through pair.
    "yield": {"s_in": "2.1", "n_in": "2.1", "w_in": "2.4", "e_in": "2.4"},
    "stop": {"s_in": "2.1", "n_in": "2.1", "w_in": "2.5", "e_in": "2.5"},
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("key", KEYS)
def test_in_the_contrast_half_the_convoy_gives_way(
    networks: Crossroads, contrast_networks: Exchanged, key: Key, layout: int
) -> None:
    signed, other = halves(networks, contrast_networks, key, layout)
    network = contrast_networks[key, 0.0]
    assert other.convoy is signed.convoy is not None
    convoy = signed.convoy.edges[0]
    ego, priority = paths(network, other)
    assert set(ego.via) & priority.yields_to
    assert not set(priority.via) & ego.yields_to
    # Nobody else meets the ego before it is through, and who has priority all the same is on the plate's list.
    target = next(s for s in other.signs if s.id == other.targets[0])
    assert convoy not in target.params.main_in
    first = {v for v in ego.yields_to if v not in priority.via}
    prior = {network.lanes[i].edge for i, links in enumerate(network.outgoing) for c in links if first & set(c.via)}
    assert prior <= set(target.params.main_in)
    # The posts are the same ones, and only some other plates hang there.
    assert [replace(s, code="2.4", params=None) for s in other.signs] == [
        replace(s, code="2.4", params=None) for s in signed.signs
    ]
    codes = {s.edge: s.code for s in other.signs}
    if key[0] == "secondary_road":
        assert codes == {convoy: "2.4", "n_in": "2.3.1"}
    elif key[0] in NEW_PLATES:
        assert codes == {e: c for e, c in NEW_PLATES[key[0]].items() if key[1] == "X" or e != "n_in"}
    else:
        assert (codes[signed.start.lane[:-2]], codes[convoy]) == ("2.1", "2.4")
        assert sorted(codes.values()) == sorted(s.code for s in signed.signs)
    for clause in other.contrast:
        assert (clause.params.approach, clause.params.exit) == signed.route_hint
        assert clause.params.main_in == target.params.main_in


@pytest.mark.parametrize("key", KEYS)
def test_no_planner_sees_the_exchange_of_priorities(
    networks: Crossroads, contrast_networks: Exchanged, key: Key
) -> None:
    seen = [build_planner_map(network).map for network in (networks[key], contrast_networks[key, 0.0])]
    assert [(a.id, a.line.points.tobytes(), a.width, a.speed) for a in seen[0].lanes] == [
        (b.id, b.line.points.tobytes(), b.width, b.speed) for b in seen[1].lanes
    ]
    areas = [{name: j.polygon.tobytes() for name, j in one.junctions.items()} for one in seen]
    assert areas[0] == areas[1]


@pytest.mark.parametrize("shape", MAPS)
def test_where_nobody_comes_to_a_stop_the_other_plate_asks_for_none(
    networks: Crossroads, contrast_networks: Exchanged, shape: str
) -> None:
    key = ("stop", shape)
    signed, other = halves(networks, contrast_networks, key, 0, empty_share=1.0)
    assert signed.convoy is other.convoy is None
    codes = [{s.edge: s.code for s in a.signs} for a in (signed, other)]
    # The ego's plate and that of the opposite approach, if there is one, change places.
    told = {"s_in": "2.5", "n_in": "2.4"}
    assert codes[0] == {e: told.get(e, "2.1") for e in codes[0]}
    assert codes[1] == {e: {"2.5": "2.4", "2.4": "2.5"}.get(c, c) for e, c in codes[0].items()}
    assert other.signs[0].params == signed.signs[0].params
    network = contrast_networks[key, 1.0]
    assert {c.state for c in network.outgoing[network.lane_index["s_in_0"]]} == {"m"}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("key", KEYS)
def test_the_convoy_shows_what_it_does_when_the_ego_is_at_its_line(networks: Crossroads, key: Key, layout: int) -> None:
    recipe, a = recipe_of(key[0]), place(networks, key, layout)
    convoy = a.convoy
    assert convoy.abrupt
    assert convoy.after_s >= recipe.number("convoy_least_after_s")
    # Seconds from the ego's line and from the lead's to the zone.
    own = convoy.ego_zone_m / convoy.ego_turn_mps
    lead = (convoy.zone_m - networks[key].lane(convoy.lane).line.length) / convoy.drivers[0].speed
    assert convoy.after_s - lead >= recipe.number("convoy_shows_s") - own - 1e-6
    # As the class of its road has it, and such that it can still stop before its line.
    limit = networks[key].expected_speed(convoy.edges[0])
    share = convoy.drivers[0].speed / limit
    arm_m = networks[key].lane(convoy.lane).line.length
    stops = (2.0 * HOLD_BRAKE_MPS2 * (arm_m - convoy.places[0] - HOLD_BEFORE_LINE_M)) ** 0.5
    assert min(recipe.number("convoy_least_share"), stops / limit) - 1e-6 <= share
    assert share <= min(recipe.number("convoy_most_share"), stops / limit) + 1e-6
    # No harder than a background driver brakes at most.
    assert convoy.drivers[0].decel <= 3.5


@pytest.mark.parametrize(
    ("number", "value", "words"),
    [
        ("convoy_least_m", 900.0, "the convoy's arm is"),
        ("convoy_most_to_zone_m", 1.0, "no path of the ego meets, near its line"),
        ("convoy_shows_s", 9.0, "shows what it does before the ego is at its line"),
    ],
)
def test_a_convoy_that_cannot_meet_the_ego_is_none(networks: Crossroads, number: str, value: float, words: str) -> None:
    key = ("yield", "X")
    task = task_of(networks[key], key, 0)
    other = replace(task.recipe, numbers={**task.recipe.numbers, number: value})
    with pytest.raises(UnfitMapError, match=words):
        placement_of(other).place(replace(task, recipe=other))
