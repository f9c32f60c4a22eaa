"""How the zones (5.31, 5.21) and least speeds (4.6) are arranged on a road made by hand, and whole sites of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pool_builders import corridor
from simworld import CALM, LIMIT, road_plain, simulation

from tsbench.dataset.maps.build import build_net
from tsbench.dataset.placements.base import Arrangement, SceneTask, UnfitMapError
from tsbench.dataset.placements.registry import placement_of
from tsbench.dataset.placements.speed_zone import task_limit
from tsbench.dataset.scenes import map_scenarios as site_module
from tsbench.dataset.scenes.lint import lint_scene
from tsbench.dataset.scenes.map_scenarios import SiteBuilder
from tsbench.dataset.scenes.recipe import Recipe, load_recipe
from tsbench.dataset.scenes.variants import INITIAL_SPEEDS_MPS, Variant, variants_of
from tsbench.roads.lane_graph import LaneGraph
from tsbench.roads.network import RoadNetwork, read_network
from tsbench.scenarios.map_pool import PoolRow
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.store import SceneFolder
from tsbench.signs.catalog import load_catalog
from tsbench.sim.scene_file import read_additional
from tsbench.sim.world import EGO_LENGTH_M

ZONES = ("zone_speed_limit", "residential_zone")
TYPES = (*ZONES, "min_speed")
LENGTH_M = 240.0
ROW = corridor(length=LENGTH_M, speed=LIMIT)


def recipe_of(type_id: str) -> Recipe:
    return load_recipe(type_id, load_catalog())


@pytest.fixture(scope="module")
def networks(tmp_path_factory: pytest.TempPathFactory) -> dict[str, RoadNetwork]:
    folder, built = tmp_path_factory.mktemp("speed"), {}
    for type_id in TYPES:
        recipe, net = recipe_of(type_id), folder / f"{type_id}.net.xml.gz"
        build_net(placement_of(recipe).prepare(ROW, road_plain(LENGTH_M), recipe), net)
        built[type_id] = read_network(net)
    return built


def place(
    networks: dict[str, RoadNetwork], type_id: str, speed: float = 7.75, seed: int = 1, row: PoolRow = ROW
) -> Arrangement:
    recipe, network = recipe_of(type_id), networks[type_id]
    variant = Variant(1, 90.0, 4.0, speed, 0, seed)
    task = SceneTask(
        row, network, LaneGraph(network), recipe, variant, (CALM,) * 12, np.random.default_rng(seed)
    )
    return placement_of(recipe).place(task)


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
    # Other traffic is bound on every edge of the zone, and on no other.
    bound = a.extra[0].get("lanes", "").split()
    assert sorted(bound) == sorted(f"road.{k}_{i}" for k in (1, 2) for i in range(3))
    if type_id == "residential_zone":
        assert (plate.value, end.value) == (20.0, 20.0)


@pytest.mark.parametrize("type_id", TYPES)
def test_half_to_all_of_the_drivers_obey(networks: dict[str, RoadNetwork], type_id: str) -> None:
    shares = []
    for seed in range(40):
        a = place(networks, type_id, seed=seed)
        minimum = float(a.signs[0].value or 0.0) / 3.6
        obey = (
            [d.speed >= minimum for d in a.drivers]
            if type_id == "min_speed"
            else [f == 1.0 for f in a.speed_factors]
        )
        shares.append(sum(obey) / len(obey))
    assert min(shares) >= 0.5
    assert max(shares) == 1.0
    assert len(set(shares)) >= 5


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


def test_minimums_as_the_road_allows() -> None:
    recipe = recipe_of("min_speed")
    for limit, values in ((60, {40, 50}), (80, {40, 50, 60}), (50, {40})):
        posted = [task_limit(corridor(f"c-{k}", speed=limit / 3.6), recipe) for k in range(300)]
        assert set(posted) == values
        assert all(posted.count(v) == pytest.approx(300 / len(values), abs=40) for v in values)
    with pytest.raises(UnfitMapError, match="the road's own limit is 40 km/h"):
        task_limit(corridor(speed=40 / 3.6), recipe)


def test_maps_that_are_too_short_or_too_narrow(networks: dict[str, RoadNetwork]) -> None:
    recipe = recipe_of("residential_zone")
    with pytest.raises(UnfitMapError, match="the corridor is 150 m long"):
        placement_of(recipe).prepare(corridor(length=150.0, speed=LIMIT), road_plain(150.0), recipe)
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

    monkeypatch.setattr(site_module, "plain_crop", lambda *_: road_plain(LENGTH_M))
    monkeypatch.setattr(site_module, "variants_of", some)
    builder = SiteBuilder(recipe_of(type_id), tmp_path, simulation())
    leaders = 0
    for k in range(3):
        site = builder.build(replace(ROW, map_id=f"c-made-{k}"), None, "test")  # type: ignore[arg-type]
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
