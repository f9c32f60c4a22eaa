"""How the zones (5.31, 5.21) and least speeds (4.6) are arranged on a road made by hand, and whole sites of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pool_builders import corridor
from simworld import CALM, FAST, LIMIT, road_plain, simulation

from tsbench.core.paths import using_city
from tsbench.dataset.maps.build import build_net
from tsbench.dataset.maps.plain import PlainNet
from tsbench.dataset.placements.by_name import placement_of
from tsbench.dataset.placements.min_speed import task_minimum
from tsbench.dataset.placements.placement import Arrangement, SceneTask, UnfitMapError
from tsbench.dataset.placements.speed_zone import needed_kmh
from tsbench.dataset.scenes import map_scenarios as site_module
from tsbench.dataset.scenes.lint import lint_scene
from tsbench.dataset.scenes.map_scenarios import SiteBuilder
from tsbench.dataset.scenes.recipe import Recipe, load_recipe
from tsbench.dataset.scenes.variants import INITIAL_SPEEDS_MPS, Variant, variants_of
from tsbench.roads.lane_graph import LaneGraph
from tsbench.roads.network import RoadNetwork, read_network
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.store import SceneFolder
from tsbench.signs.catalog import load_catalog
from tsbench.signs.contrast import SlowZoneParams
from tsbench.sim.scene_file import read_additional
from tsbench.sim.world import EGO_LENGTH_M

ZONES = ("zone_speed_limit", "residential_zone")
TYPES = (*ZONES, "min_speed")
LENGTH_M = 240.0
ROWS = {
    "zone_speed_limit": corridor(length=LENGTH_M, speed=FAST),
    "residential_zone": corridor(length=LENGTH_M, speed=11.11, road_class="residential"),
    "min_speed": corridor(length=LENGTH_M, speed=LIMIT),
}


def road_of(type_id: str) -> PlainNet:
    return road_plain(LENGTH_M, speed=ROWS[type_id].speed_mps)


def recipe_of(type_id: str) -> Recipe:
    return load_recipe(type_id, load_catalog())


@pytest.fixture(scope="module")
def networks(tmp_path_factory: pytest.TempPathFactory) -> dict[str, RoadNetwork]:
    folder, built = tmp_path_factory.mktemp("speed"), {}
    for type_id in TYPES:
        recipe, net = recipe_of(type_id), folder / f"{type_id}.net.xml.gz"
        build_net(placement_of(recipe).prepare(ROWS[type_id], road_of(type_id), recipe), net)
        built[type_id] = read_network(net)
    return built


def task_of(
    networks: dict[str, RoadNetwork], type_id: str, speed: float = 7.75, seed: int = 1, asked: int = 0
) -> SceneTask:
    """asked: number on the axes of what the plates post."""
    recipe, network = recipe_of(type_id), networks[type_id]
    variant = Variant(1, 90.0, 4.0, speed, 0, seed, value=asked, plate=asked)
    slow = replace(CALM, speed=6.0)
    return SceneTask(
        ROWS[type_id], network, LaneGraph(network), recipe, variant, (CALM, slow), np.random.default_rng(seed)
    )


def place(networks: dict[str, RoadNetwork], type_id: str, speed: float = 7.75, seed: int = 1) -> Arrangement:
    task = task_of(networks, type_id, speed, seed)
    return placement_of(task.recipe).place(task)


@pytest.mark.parametrize("type_id", ZONES)
def test_a_zone_spans_edges_up_to_its_end_plate(networks: dict[str, RoadNetwork], type_id: str) -> None:
    network, recipe = networks[type_id], recipe_of(type_id)
    a = place(networks, type_id)
    plate, end = a.signs
    kind = load_catalog().type(type_id)
    assert (plate.code, end.code, end.ends) == (kind.codes[0], kind.end_codes[0], plate.id)
    assert plate.params.zone_edges == ("road.1", "road.2", "road.3")
    assert (plate.edge, plate.position_m, end.edge, end.position_m) == ("road.1", 0.0, "road.3", 0.0)
    assert a.route_hint == ("road.0", "road.1", "road.2", "road.3")
    zone = sum(network.edges[e].length for e in ("road.1", "road.2"))
    assert zone >= recipe.number("zone_m") - 1.0
    assert network.edges["road.1"].length == pytest.approx(network.edges["road.2"].length, abs=0.3)
    assert a.route_length == pytest.approx(zone + recipe.number("end_plate_before_destination_m"))
    if type_id == "residential_zone":
        assert (plate.value, end.value) == (20.0, 20.0)


@pytest.mark.parametrize("type_id", ZONES)
@pytest.mark.parametrize("asked", range(6))
def test_the_contrast_half_posts_what_the_road_s_traffic_keeps_to(
    networks: dict[str, RoadNetwork], type_id: str, asked: int
) -> None:
    task = task_of(networks, type_id, asked=asked)
    placement, road = placement_of(task.recipe), task.row.speed_mps * 3.6
    signed = placement.place(task)
    other = placement.contrast(task, signed)
    assert other is not None
    (first, end), (high, high_end) = signed.signs, other.signs
    limits = task.recipe.choices["limits_kmh"]
    assert first.posted == limits[asked % len(limits)]
    assert high.posted >= max(1.6 * first.posted, road - 0.5)
    codes = ("5.31", "5.32")
    assert (high, high_end) == tuple(
        replace(s, code=code, value=high.posted) for s, code in zip((first, end), codes, strict=True)
    )
    assert replace(other, signs=signed.signs, contrast=()) == signed
    (clause,) = other.contrast
    slow = clause.params
    assert isinstance(slow, SlowZoneParams)
    assert (clause.name, slow.zone_edges, slow.start_m) == ("needless_slow", ("road.1", "road.2"), 0.0)
    assert slow.end_m == pytest.approx(high_end.x - high.x, abs=0.5)
    assert slow.limit_kmh == pytest.approx(min(high.posted, road))
    # Whoever keeps to the one, or follows who is as slow as anybody, does not keep to the other.
    needed = needed_kmh(first.posted)
    assert needed == pytest.approx((first.posted + 1.0) / 0.7)
    assert needed <= slow.limit_kmh
    assert [d.speed * 3.6 for d in signed.drivers] == pytest.approx(
        [max(CALM.speed * 3.6, needed), max(21.6, needed)]
    )


def test_every_value_of_a_type_is_there_as_often(networks: dict[str, RoadNetwork]) -> None:
    tasks = [task_of(networks, "zone_speed_limit", asked=k) for k in range(30)]
    posted = [placement_of(t.recipe).place(t).signs[0].value for t in tasks]
    assert {v: posted.count(v) for v in posted} == {20.0: 10, 30.0: 10, 40.0: 10}


@pytest.mark.parametrize(("kink", "fits"), [(60.0, True), (130.0, False), (200.0, True)])
def test_a_bend_in_the_zone_is_an_excuse_to_be_slow(
    networks: dict[str, RoadNetwork], tmp_path: Path, kink: float, fits: bool
) -> None:
    task = task_of(networks, "zone_speed_limit")
    crop = road_of("zone_speed_limit")
    (road,) = crop.edges
    shape = ((0.0, 0.0), (kink, 0.0), (LENGTH_M, 0.1 * (LENGTH_M - kink)))
    bent = replace(crop, edges=(replace(road, shape=shape),))
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
def test_the_other_plate_of_a_least_speed(networks: dict[str, RoadNetwork], asked: int) -> None:
    task = task_of(networks, "min_speed", asked=asked)
    placement = placement_of(task.recipe)
    signed = placement.place(task)
    other = placement.contrast(task, signed)
    assert other is not None
    (sign,) = signed.signs
    assert other == replace(signed, signs=(replace(sign, code="3.24", value=sign.posted - 10.0),))
    # Nobody but a leader of the scene's own is slow enough to excuse.
    assert min(d.speed for d in signed.drivers) * 3.6 >= sign.posted + 3.0


@pytest.mark.parametrize("initial", INITIAL_SPEEDS_MPS)
@pytest.mark.parametrize("seed", range(6))
def test_min_speed(networks: dict[str, RoadNetwork], initial: float, seed: int) -> None:
    network, recipe = networks["min_speed"], recipe_of("min_speed")
    a = place(networks, "min_speed", initial, seed)
    (plate,) = a.signs
    lane = network.lane(a.start.lane)
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
    if a.extra:
        kind, leader = a.extra
        assert (kind.tag, leader.tag, leader.get("departLane")) == ("vType", "vehicle", str(lane.order))
        speed = float(leader.get("departSpeed", "nan")) * 3.6
        assert speed == pytest.approx(minimum - recipe.number("leader_below_kmh"), abs=0.01)
        assert float(kind.get("maxSpeed", "nan")) * 3.6 == pytest.approx(speed, abs=0.01)
        rear = float(leader.get("departPos", "nan")) - float(kind.get("length", "nan"))
        assert rear - front == pytest.approx(recipe.number("leader_gap_m"), abs=0.1)
        assert a.blocked[0][0] == lane.id
        assert a.blocked[0][2] > float(leader.get("departPos", "nan")) + 20.0


def test_slower_variants_start_farther_below_and_leaders_are_rare(networks: dict[str, RoadNetwork]) -> None:
    starts = [place(networks, "min_speed", v).start.speed for v in INITIAL_SPEEDS_MPS]
    assert starts == sorted(set(starts))
    leaders = [bool(place(networks, "min_speed", seed=s).extra) for s in range(100)]
    assert 10 <= sum(leaders) <= 45


def test_minimums_as_the_road_allows(networks: dict[str, RoadNetwork]) -> None:
    def posted(limit: int, shown: int = 130) -> list[float]:
        tasks = [task_of(networks, "min_speed", asked=k) for k in range(6)]
        classes = {edge.road_class for edge in tasks[0].network.edges.values()}
        network = replace(tasks[0].network, class_speed=dict.fromkeys(classes, shown / 3.6))
        return [task_minimum(replace(t, row=corridor(speed=limit / 3.6), network=network)) for t in tasks]

    assert posted(60) == [40.0, 50.0] * 3
    assert posted(80, shown=60) == posted(60)
    assert posted(80) == [40.0, 50.0, 60.0] * 2
    assert posted(50) == [40.0] * 6
    with pytest.raises(UnfitMapError, match="the road's own limit is 40 km/h"):
        posted(40)


def test_maps_that_are_too_short_or_too_narrow(networks: dict[str, RoadNetwork]) -> None:
    recipe = recipe_of("residential_zone")
    with pytest.raises(UnfitMapError, match="the corridor is 150 m long"):
        placement_of(recipe).prepare(corridor(length=150.0, speed=FAST), road_plain(150.0), recipe)
    with pytest.raises(UnfitMapError, match="50 km/h is no limit of its class"):
        placement_of(recipe).prepare(corridor(length=LENGTH_M, speed=LIMIT), road_plain(LENGTH_M), recipe)
    task = task_of(networks, "zone_speed_limit")
    placement = placement_of(task.recipe)
    with pytest.raises(UnfitMapError, match="the road's own limit is 50 km/h"):
        placement.place(replace(task, row=ROWS["min_speed"]))
    signed = placement.place(task)
    with pytest.raises(UnfitMapError, match="no value for a road of 80 km/h"):
        placement.contrast(replace(task, row=corridor(speed=80 / 3.6)), signed)
    narrow = dict(networks)
    net = networks["min_speed"]
    one = replace(net.edges["road"], lanes=net.edges["road"].lanes[:1])
    narrow["min_speed"] = replace(net, edges={**net.edges, "road": one})
    with pytest.raises(UnfitMapError, match="1 lanes for cars"):
        place(narrow, "min_speed")


@pytest.mark.parametrize("type_id", TYPES)
def test_a_site_is_sound_and_its_leader_is_there(
    type_id: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def some(kind: str, map_id: str) -> tuple[Variant, ...]:
        return tuple(v for v in variants_of(kind, map_id) if v.number < 4)

    monkeypatch.setattr(site_module, "plain_crop", lambda *_: road_of(type_id))
    monkeypatch.setattr(site_module, "variants_of", some)
    builder = SiteBuilder(recipe_of(type_id), tmp_path, simulation())
    leaders = 0
    for k in range(3):
        site = builder.build(replace(ROWS[type_id], map_id=f"c-made-{k}"), None, "test")  # type: ignore[arg-type]
        assert site.reason == ""
        for row in site.rows:
            scene, roads = SceneLoader(SceneFolder(tmp_path)).load(row)
            assert list(lint_scene(scene, roads.graph)) == []
            vehicles = {
                v.get("id")
                for v in read_additional(scene.additional.path, scene.additional.content).iterfind("vehicle")
            }
            leaders += "leader_0" in vehicles
    assert (leaders > 0) == (type_id == "min_speed")


def test_where_50_is_usual_20_and_30_are_posted(networks: dict[str, RoadNetwork]) -> None:
    """A city's values are those of which its usual limit leaves room: 40 is too near."""
    town = replace(ROWS["zone_speed_limit"], speed_mps=50 / 3.6)
    tasks = [replace(task_of(networks, "zone_speed_limit", asked=k), row=town) for k in range(4)]
    with pytest.raises(UnfitMapError, match="the road's own limit is 50 km/h"):
        placement_of(tasks[0].recipe).place(tasks[0])
    with using_city("north-bayreuth"):
        posted = [placement_of(task.recipe).place(task).signs[0].posted for task in tasks]
        assert posted == [20, 30, 20, 30]
        slow = replace(tasks[0], row=replace(town, speed_mps=40 / 3.6))
        with pytest.raises(UnfitMapError, match="the road's own limit is 40 km/h"):
            placement_of(slow.recipe).place(slow)
