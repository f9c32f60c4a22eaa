"""How limits, zones and least speeds are arranged on a two-way road made by hand, and whole sites of them."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import pytest
from pool_builders import Networks, built_site, corridor, halves_of, recipe_of, scene_task, signed_half, two_way
from simworld import CALM, FAST, LIMIT, loader_of

from tsbench.make.maps.netconvert import build_net
from tsbench.make.placements.by_name import placement_of
from tsbench.make.placements.placement import Arrangement, SceneTask, UnfitMapError
from tsbench.make.placements.speed_zone import task_minimum
from tsbench.make.scenes.plate_surroundings import scene_vehicles
from tsbench.make.scenes.recipe import INITIAL_SPEEDS_MPS, Variant
from tsbench.make.scenes.verify import lint_scene
from tsbench.roads.lane_graph import LaneGraph
from tsbench.roads.network import read_network
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.catalog import load_catalog
from tsbench.signs.contrast import SlowZoneParams
from tsbench.signs.rule_kinds import ZoneParams
from tsbench.sim.scene_file import EGO_ID
from tsbench.sim.world import EGO_LENGTH_M

ZONES = ("speed_limit", "zone_speed_limit", "residential_zone")
LENGTH_M = 240.0
MAPS = {
    "speed_limit": two_way(),
    "zone_speed_limit": two_way("tertiary"),
    "residential_zone": two_way("residential", 11.11),
    "min_speed": two_way(speed=LIMIT),
}


def task_of(networks: Networks, type_id: str, speed: float = 7.75, seed: int = 1, asked: int = 0) -> SceneTask:
    """asked: number on the axes of what the plates post."""
    variant = Variant(1, 90.0, 4.0, speed, 0, seed, value=asked, plate=asked)
    task = scene_task(MAPS[type_id][0], networks[type_id], recipe_of(type_id), variant, seed)
    return replace(task, drivers=(CALM, replace(CALM, speed=5.0)))


def place(networks: Networks, type_id: str, speed: float = 7.75, seed: int = 1) -> Arrangement:
    return signed_half(task_of(networks, type_id, speed, seed))


@pytest.mark.parametrize("type_id", ZONES)
def test_a_zone_spans_edges_from_its_plate(networks: Networks, type_id: str) -> None:
    network, recipe = networks[type_id], recipe_of(type_id)
    a, kind = place(networks, type_id), load_catalog().type(type_id)
    plate, end = a.signs[:2]
    assert plate.code == kind.codes[0]
    zone = [f"road.{k + 1}" for k in range(int(recipe.number("zone_edges")))]
    last = f"road.{len(zone) + 1}"
    assert plate.params.zone_edges == (*zone, last)
    assert (plate.edge, plate.position_m, a.extra) == ("road.1", 0.0, ())
    if type_id == "speed_limit":
        assert (end.code, end.value) == (kind.end_codes[0], plate.value)
        assert (end.edge, end.position_m, end.ends) == (last, 0.0, plate.id)
        zone.append(last)
    assert a.route_hint == ("road.0", *zone)
    # The network keeps the road's own limit.
    lengths = [network.edges[e].length for e in plate.params.zone_edges[:-1]]
    assert {lane.speed for lane in network.lanes if not lane.internal} == {MAPS[type_id][0].speed_mps}
    assert sum(lengths) >= recipe.number("zone_m") - 1.0
    assert lengths == pytest.approx([lengths[0]] * len(lengths), abs=0.3)
    before = [network.edges[e].length for e in zone[:-1]]
    assert a.route_length == pytest.approx(sum(before) + a.destination.s)
    assert a.destination.edge == zone[-1]
    assert recipe.number("destination_behind_m") <= a.destination.s < network.edges[zone[-1]].length


@pytest.mark.parametrize("type_id", ZONES[1:])
def test_two_zones_share_a_border_and_the_ego_starts_no_faster_than_the_other_allows(
    networks: Networks, type_id: str
) -> None:
    signed, contrast = halves_of(task_of(networks, type_id))
    low, high = ((half.signs[0].code, half.signs[0].posted) for half in (signed, contrast))
    assert low[1] < high[1]
    end_of = {"5.21": "5.22", "5.31": "5.32"}
    for half, ours, theirs in ((signed, low, high), (contrast, high, low)):
        begin, other, *ends = half.signs
        assert [(s.code, s.posted, s.edge) for s in (begin, other)] == [(*ours, "road.1"), (*theirs, "back")]
        # Zones of one kind end where another begins.
        hung = [(end_of[theirs[0]], theirs[1], "road.0"), (end_of[ours[0]], ours[1], "back")]
        assert [(s.code, s.posted, s.edge) for s in ends] == hung * (ours[0] != theirs[0])
        assert abs(begin.x - other.x) < 1.0
        assert low[1] < half.start.speed * 3.6 <= high[1] + 1e-9


@pytest.mark.parametrize("initial", INITIAL_SPEEDS_MPS)
@pytest.mark.parametrize("seed", range(5))
def test_half_a_second_and_then_3_5_mps2_bring_the_ego_to_the_limit_at_the_plate(
    networks: Networks, initial: float, seed: int
) -> None:
    recipe, a = recipe_of("speed_limit"), place(networks, "speed_limit", initial, seed)
    v, v0 = a.signs[0].posted / 3.6, a.start.speed
    assert min(v + recipe.number("least_excess_mps"), FAST) - 1e-9 <= v0
    assert v0 <= v + recipe.number("most_excess_kmh") / 3.6 + 1e-9
    way = networks["speed_limit"].lane(a.start.lane).line.length - a.start.s - EGO_LENGTH_M / 2
    need = 0.5 * v0 + (v0**2 - v**2) / (2 * 3.5)
    assert need <= way <= need + 3.0 + recipe.number("jitter_m") + 0.01


@pytest.mark.parametrize("type_id", ZONES)
def test_the_contrast_half_posts_another_value_and_asks_not_to_be_slow(networks: Networks, type_id: str) -> None:
    task = task_of(networks, type_id)
    signed, other = halves_of(task)
    high = other.signs[0]
    codes = ("3.24", "3.25") if type_id == "speed_limit" else ("5.31", "5.32")
    assert high == replace(signed.signs[0], code=codes[0], value=high.posted)
    assert [replace(s, code="X", value=None) for s in other.signs] == [
        replace(s, code="X", value=None) for s in signed.signs
    ]
    assert replace(other, signs=signed.signs, contrast=()) == signed
    (clause,) = other.contrast
    slow = clause.params
    assert isinstance(slow, SlowZoneParams)
    assert (clause.name, slow.start_m) == ("needless_slow", 0.0)
    assert slow.zone_edges == signed.signs[0].params_as(ZoneParams).zone_edges[:-1]
    lengths = [task.network.edge_lanes(e)[0].line.length for e in slow.zone_edges]
    assert slow.end_m == pytest.approx(sum(lengths), abs=0.5)
    assert slow.limit_kmh == pytest.approx(min(high.posted, task.row.speed_mps * 3.6))


@pytest.mark.parametrize(
    ("type_id", "road_class", "road_kmh", "pairs"),
    [
        ("speed_limit", "secondary", 60, {30: {50, 60}}),
        ("speed_limit", "tertiary", 60, {20: {40, 50, 60}, 30: {50, 60}}),
        ("zone_speed_limit", "secondary", 60, {}),
        ("zone_speed_limit", "tertiary", 60, {20: {40, 50}, 30: {50}}),
        ("zone_speed_limit", "residential", 40, {20: {40}}),
        ("residential_zone", "residential", 40, {20: {40}}),
        ("residential_zone", "secondary", 60, {}),
    ],
)
def test_both_halves_post_values_of_the_roads_class(
    networks: Networks, type_id: str, road_class: str, road_kmh: int, pairs: dict[int, set[int]]
) -> None:
    row = replace(MAPS[type_id][0], road_class=road_class, speed_mps=road_kmh / 3.6)
    found = defaultdict(list)
    for asked in range(12):
        task = task_of(networks, type_id, asked=asked)
        task = replace(task, row=row, variant=replace(task.variant, plate=asked // 2))
        if not pairs:
            with pytest.raises(UnfitMapError, match=f"no pair of limits for a {road_class} road of"):
                signed_half(task)
            continue
        signed, other = halves_of(task)
        found[signed.signs[0].posted].append(other.signs[0].posted)
    assert {limit: set(values) for limit, values in found.items()} == pairs
    # Each limit is there as often.
    assert len({len(values) for values in found.values()}) <= 1


@pytest.mark.parametrize(("kink", "fits"), [(60.0, True), (130.0, False), (200.0, True)])
def test_a_bend_in_the_zone_is_an_excuse_to_be_slow(
    networks: Networks, tmp_path: Path, kink: float, fits: bool
) -> None:
    task = task_of(networks, "zone_speed_limit")
    _, crop = MAPS["zone_speed_limit"]
    road, back = crop.edges
    shape = ((0.0, 0.0), (kink, 0.0), (LENGTH_M, 0.1 * (LENGTH_M - kink)))
    bent = replace(crop, edges=(replace(road, shape=shape), back))
    placement, net = placement_of(task.recipe), tmp_path / "bent.net.xml.gz"
    build_net(placement.prepare(task.row, bent, task.recipe), net)
    network = read_network(net)
    task = replace(task, network=network, graph=LaneGraph(network))
    if fits:
        placement.place(task)
    else:
        with pytest.raises(UnfitMapError, match=r"the zone has a bend for \d\d km/h"):
            placement.place(task)


@pytest.mark.parametrize("asked", range(3))
def test_the_other_plate_of_a_least_speed(networks: Networks, asked: int) -> None:
    task = task_of(networks, "min_speed", asked=asked)
    signed, other = halves_of(task)
    (sign,) = signed.signs
    assert other == replace(signed, signs=(replace(sign, code="3.24", value=sign.posted - 10.0),))
    # No vehicle could keep both plates.
    assert signed.closed_edges == set(task.network.edges)


@pytest.mark.parametrize("initial", INITIAL_SPEEDS_MPS)
@pytest.mark.parametrize("seed", range(6))
def test_min_speed(networks: Networks, initial: float, seed: int) -> None:
    recipe, a = recipe_of("min_speed"), place(networks, "min_speed", initial, seed)
    (plate,) = a.signs
    minimum = float(plate.value or 0.0)
    assert minimum == 40.0  # the road's own limit is 50
    assert 12.0 - 1e-6 <= minimum - a.start.speed * 3.6 <= 18.0 + 1e-6
    front = a.start.s + EGO_LENGTH_M / 2
    assert plate.position_m - front == pytest.approx(30.0)
    assert (*plate.params.zone_edges, plate.edge, a.destination.edge) == ("road",) * 3
    # The slow style arrives within the horizon.
    assert a.destination.s - a.start.s < 3.0 * recipe.horizon / 10
    # Where the rule binds there is room for a slow driver to show.
    settle = load_catalog().sign("4.6").rule.thresholds["settle_distance_m"]
    assert a.destination.s - plate.position_m >= recipe.number("zone_m") - 1e-6
    assert recipe.number("zone_m") - settle >= 60.0


def test_slower_variants_start_farther_below(networks: Networks) -> None:
    starts = [place(networks, "min_speed", v).start.speed for v in INITIAL_SPEEDS_MPS]
    assert starts == sorted(set(starts))


def test_minimums_as_the_road_allows(networks: Networks) -> None:
    def posted(limit: int, shown: int = 130) -> list[float]:
        tasks = [task_of(networks, "min_speed", asked=k) for k in range(6)]
        classes = {edge.road_class for edge in tasks[0].network.edges.values()}
        network = replace(tasks[0].network, class_speed=dict.fromkeys(classes, shown / 3.6))
        return [task_minimum(replace(t, row=corridor(speed=limit / 3.6), network=network)) for t in tasks]

    assert posted(60) == [40.0, 50.0] * 3
    assert posted(80, shown=60) == posted(60)
    assert posted(80) == [40.0, 50.0, 60.0] * 2
    assert posted(50) == [40.0] * 6
    with pytest.raises(UnfitMapError, match="no minimum for a secondary road of 40 km/h"):
        posted(40)


@pytest.mark.parametrize("type_id", MAPS)
def test_a_road_without_another_direction_is_unfit(type_id: str) -> None:
    row, crop = MAPS[type_id]
    recipe = recipe_of(type_id)
    with pytest.raises(UnfitMapError, match=r"no other direction, where the other half's plates? faces?"):
        placement_of(recipe).prepare(replace(row, oneway=True), crop, recipe)


def test_maps_that_are_too_short_or_too_narrow(networks: Networks) -> None:
    recipe = recipe_of("zone_speed_limit")
    placement = placement_of(recipe)
    with pytest.raises(UnfitMapError, match="the corridor is 150 m long"):
        placement.prepare(*two_way(length=150.0), recipe)
    with pytest.raises(UnfitMapError, match="50 km/h is no limit of its class"):
        placement.prepare(*two_way(speed=LIMIT), recipe)
    road, plain = two_way(speed=LIMIT)
    placement.prepare(road, replace(plain, data=DataSet("north-bayreuth")), recipe)
    net = networks["min_speed"]
    one = replace(net.edges["road"], lanes=net.edges["road"].lanes[:1])
    narrow = networks | {"min_speed": replace(net, edges={**net.edges, "road": one})}
    with pytest.raises(UnfitMapError, match="1 lanes for cars"):
        place(narrow, "min_speed")


@pytest.mark.parametrize("type_id", MAPS)
def test_a_site_is_sound_and_has_only_oncoming_vehicles_that_keep_the_lower_limit(type_id: str, tmp_path: Path) -> None:
    site = built_site(recipe_of(type_id), tmp_path, MAPS[type_id], lambda variants: variants[1:3])
    assert site.reason == ""
    for row in site.rows:
        scene, roads = loader_of(tmp_path).load(row)
        assert list(lint_scene(scene, roads.graph)) == []
        others = [v for v in scene_vehicles(scene) if v.id != EGO_ID]
        assert bool(others) == bool(row.density) == (type_id != "min_speed")
        # The other half's plates face them: no driver is faster than the lower limit of the two halves.
        lower = min(r.sign_value or 0.0 for r in site.rows if r.variant == row.variant)
        assert {v.edges for v in others} <= {("back",)}
        assert all(v.speed * 3.6 <= lower + 0.1 for v in others)
