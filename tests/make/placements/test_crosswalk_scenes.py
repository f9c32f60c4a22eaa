"""Crosswalk scenes on roads made by hand: the network, the arrangement, and whole sites that are driven."""

from __future__ import annotations

import hashlib
import math
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from patience import HANG_S
from pool_builders import Networks, built_site, corridor, prepared, recipe_of, scene_task, signed_half
from simworld import LIMIT, driven, loader_of, simulation

from tsbench.make.certify.certifier import Certifier
from tsbench.make.maps.plain import PlainEdge, PlainNet, PlainNode
from tsbench.make.placements.by_name import placement_of
from tsbench.make.placements.crosswalk import bend_speed, kerb_to_kerb, to_crossing
from tsbench.make.placements.placement import Arrangement, UnfitMapError
from tsbench.make.placements.speed_zone import KMH
from tsbench.make.scenes.map_scenarios import MapScenarios
from tsbench.make.scenes.recipe import Variant
from tsbench.make.scenes.verify import lint_scene
from tsbench.metrics.scd import is_scd
from tsbench.report.drawing.canvas import STYLE
from tsbench.report.drawing.scene_shapes import staged_bodies
from tsbench.report.scene_pictures import scene_picture
from tsbench.roads.network import RoadNetwork
from tsbench.roads.planner_map import build_planner_map
from tsbench.roads.road_map import Crossing
from tsbench.scenarios.map_pool import PoolRow
from tsbench.scenarios.spec import CONTRAST, SIGNED, ScenarioSpec
from tsbench.signs.rule_kinds import CrosswalkParams
from tsbench.sim.ego import MAX_DECEL_MPS2
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S, EGO_LENGTH_M, ActorKind

BEND = ((0.0, 0.0), (60.0, 0.0), (110.0, 12.0), (230.0, 14.0))
LINES = {
    "two_way": (((0.0, 0.0), (240.0, 0.0)), 2, 1),
    "wide": (((0.0, 0.0), (0.0, 240.0)), 3, 2),
    "bent": (BEND, 1, 1),
    "lane": (((0.0, 0.0), (-170.0, 170.0)), 1, 1),
}


def road(name: str) -> tuple[PoolRow, PlainNet]:
    """A pool row and its crop: lanes in the ego's direction, and in the other one."""
    shape, lanes, back = LINES[name]
    nodes = (PlainNode("a", *shape[0]), PlainNode("b", *shape[-1]))
    edges = (
        PlainEdge("road", "a", "b", lanes, LIMIT, 9, shape, type="highway.secondary"),
        PlainEdge("back", "b", "a", back, LIMIT, 9, shape[::-1], type="highway.secondary"),
    )
    row = corridor(lanes=lanes, length=240.0, speed=LIMIT, opposite="back")
    return row, PlainNet(nodes, edges, ())


@pytest.fixture(scope="module")
def networks(tmp_path_factory: pytest.TempPathFactory) -> Networks:
    folder = tmp_path_factory.mktemp("crosswalk")
    return {name: prepared(folder, "crosswalk", *road(name)) for name in LINES}


def first_crossing(network: RoadNetwork) -> Crossing:
    """The one that the ego comes to."""
    return next(c for c in network.crossings.values() if "road.0" in c.edges)


def place(networks: Networks, name: str, layout: int = 0, seed: int = 1) -> Arrangement:
    variant = Variant(1, 90.0, 4.0, 7.75, 0, layout)
    return signed_half(scene_task(road(name)[0], networks[name], recipe_of("crosswalk"), variant, seed))


@pytest.mark.parametrize("name", LINES)
def test_the_whole_road_is_crossed_and_lanes_keep_their_numbers(networks: Networks, name: str) -> None:
    network, (_, lanes, back) = networks[name], LINES[name]
    crossing = first_crossing(network)
    assert {c.width for c in network.crossings.values()} == {4.0}
    edges = sorted(sorted(c.edges) for c in network.crossings.values())
    assert edges == [["back.1", "road.1"], ["back.2", "road.0"]]
    width = network.edge_lanes("road.0")[0].width
    assert crossing.line.length == pytest.approx((lanes + back) * width, abs=0.2)
    for edge, count in (("road", lanes), ("back", back)):
        for k in range(3):
            assert [i.permits("passenger") for i in network.edge_lanes(f"{edge}.{k}")] == [True] * count
    for lane in network.edge_lanes("road.0"):
        # Cars wait for who crosses: SUMO's "m".
        (link,) = network.outgoing[lane.index]
        assert link.state == "m"
        assert network.lanes[link.to_lane].id == f"road.1_{lane.order}"
        assert 0.0 <= to_crossing(lane, crossing) <= 3.0
    for side in ("right", "left"):
        (path,) = network.edge_lanes(f"road.path0_{side}")
        assert path.permits("pedestrian")
        assert not path.permits("passenger")
        kerb = kerb_to_kerb(crossing, network.edge_lanes("road.0")[0], side).points[0]
        beside = network.edge_lanes("road.0")[0].line.project(*path.line.points[0])[1]
        assert (beside < 0.0) == (side == "right")
        assert math.dist(path.line.points[-1], kerb) < 3.0


def test_planners_are_told_both_crossings_of_a_road(networks: Networks) -> None:
    network = networks["two_way"]
    told = build_planner_map(network).map.crossings
    lines = sorted(c.line.points.tolist() for c in told.values())
    assert lines == sorted(c.line.points.tolist() for c in network.crossings.values())
    assert {name: crossing.id for name, crossing in told.items()} == {name: name for name in told}


@pytest.mark.parametrize("name", LINES)
@pytest.mark.parametrize("layout", range(6))
def test_people_come_as_the_preset_says(networks: Networks, name: str, layout: int) -> None:
    preset = recipe_of("crosswalk").choices["presets"][layout % 5]
    network = networks[name]
    crossing = first_crossing(network)
    first = network.edge_lanes("road.0")[0]
    for seed in range(8):
        a = place(networks, name, layout, seed)
        assert a.walkers is not None
        persons = [e for e in a.extra if e.tag == "person"]
        assert tuple(p.get("id") for p in persons) == a.walkers.persons
        assert len(persons) == preset["count"]
        times, sides = [], []
        for person, speed in zip(persons, a.walkers.speeds, strict=True):
            way = str(person[1].get("edges")).split()
            sides.append(way[0].rsplit("_", 1)[1])
            assert way == [f"road.path0_{s}" for s in (sides[-1], "left" if sides[-1] == "right" else "right")]
            line = network.edge_lanes(way[0])[0].line
            kerb = kerb_to_kerb(crossing, first, sides[-1]).points[0]
            at = float(person.get("departPos", "nan"))
            assert 0.0 <= at < line.length
            times.append((math.dist(line.points[0], kerb) - at) / speed)
            assert 1.0 <= speed <= 1.4
            assert float(person[1].get("speed", "nan")) == pytest.approx(speed, abs=0.001)
        assert a.walkers.come_up_s == recipe_of("crosswalk").number("come_up_s")
        waits = (times[0] - a.walkers.come_up_s) * a.walkers.speeds[0]
        assert waits == pytest.approx(recipe_of("crosswalk").number("wait_from_kerb_m"), abs=0.01)
        if "gap_s" in preset:
            assert np.diff(times) == pytest.approx([preset["gap_s"]] * (len(times) - 1), abs=0.01)
            assert len(set(sides)) == 1
        else:
            assert all(x != y for x, y in pairwise(sides))
            gaps = [preset["gap_share"] * crossing.line.length / v for v in a.walkers.speeds[:-1]]
            assert np.diff(times) == pytest.approx(gaps, abs=0.01)


@pytest.mark.parametrize("name", LINES)
@pytest.mark.parametrize("seed", range(6))
def test_the_first_is_on_the_road_when_the_ego_is_there(networks: Networks, name: str, seed: int) -> None:
    network = networks[name]
    a = place(networks, name, seed, seed)
    crossing, sign = first_crossing(network), a.signs[0]
    assert a.walkers is not None
    assert sign.params == CrosswalkParams(crossing.id, "road.1")
    lane = network.lane(a.start.lane)
    assert a.walkers.line_lane == lane.id
    ahead = to_crossing(lane, crossing)
    assert a.walkers.ego_zone_m == pytest.approx(ahead)
    front = a.start.s + EGO_LENGTH_M / 2
    assert lane.line.length + ahead - front == pytest.approx(90.0, abs=1e-6)
    cruise = a.walkers.ego_cruise_mps
    assert recipe_of("crosswalk").number("start_speed_share") * cruise - 0.01 <= a.start.speed <= cruise
    # Of the first: its way until the ego is there ends on the road.
    assert a.walkers.lead_time_s * min(a.walkers.speeds) > recipe_of("crosswalk").number("wait_from_kerb_m") + 0.2
    # In the plain scene they set off when an ego that nobody holds up would make them.
    waits = {float(e[0].get("duration", "nan")) for e in a.extra if e.tag == "person"}
    assert len(waits) == 1
    assert 0.0 <= waits.pop() < 20.0


def test_a_bend_before_the_crossing_is_reckoned_with(networks: Networks) -> None:
    def allowed(name: str) -> float:
        lane = networks[name].lane("road.0_0")
        onward = networks[name].lanes[networks[name].outgoing[lane.index][0].to_lane]
        return bend_speed(lane, onward, 50.0, 2.2)

    assert allowed("two_way") > 30.0
    # 13.5 degrees at one corner within 6 m: a radius of 25 m.
    assert allowed("bent") == pytest.approx(math.sqrt(2.2 * 6.0 / math.atan2(12.0, 50.0)), rel=0.15)
    a = place(networks, "bent")
    assert a.walkers.ego_cruise_mps == pytest.approx(allowed("bent"), abs=0.01)


def test_what_cannot_carry_it() -> None:
    placement = placement_of(recipe_of("crosswalk"))
    row, plain = road("wide")
    there, back = plain.edges
    with pytest.raises(UnfitMapError, match="4 lanes"):
        placement.prepare(row, replace(plain, edges=(replace(there, num_lanes=4), back)), recipe_of("crosswalk"))
    with pytest.raises(UnfitMapError, match="no other direction"):
        placement.prepare(row, replace(plain, edges=(there,)), recipe_of("crosswalk"))
    short = replace(plain, edges=(replace(there, shape=((0.0, 0.0), (0.0, 120.0))), back))
    with pytest.raises(UnfitMapError, match="the corridor is 120 m long"):
        placement.prepare(row, short, recipe_of("crosswalk"))
    row, plain = road("two_way")
    broad = replace(plain, edges=(plain.edges[0], replace(plain.edges[1], num_lanes=4)))
    with pytest.raises(UnfitMapError, match="more lanes in the other direction"):
        placement.prepare(row, broad, recipe_of("crosswalk"))


def build(name: str, root: Path) -> MapScenarios:
    """The site of a road, with two of its variants."""
    return built_site(recipe_of("crosswalk"), root, road(name), lambda variants: variants[:2])


SiteOf = Callable[[str], tuple[MapScenarios, Path]]


@pytest.fixture(scope="module")
def site_of(tmp_path_factory: pytest.TempPathFactory) -> SiteOf:
    """A road's site and its folder, built once."""

    @cache
    def site(name: str) -> tuple[MapScenarios, Path]:
        root = tmp_path_factory.mktemp(name)
        return build(name, root), root

    return site


@pytest.mark.parametrize("name", LINES)
def test_a_site_is_sound_and_tells_who_yields(name: str, site_of: SiteOf, tmp_path: Path) -> None:
    site, root = site_of(name)
    assert site.reason == ""
    loader = loader_of(root)
    for row in site.rows:
        scene, roads = loader.load(row)
        assert list(lint_scene(scene, roads.graph)) == []
        assert scene.walkers is not None
        for planner, obeys in (("idm", row.half == CONTRAST), ("idm-e", True)):
            result = driven(row, root, planner)
            assert result.error == ""
            assert result.facts.verdicts.engaged
            assert is_scd(result.facts) == obeys
    assert build(name, tmp_path) == site


@pytest.mark.parametrize("name", LINES)
def test_the_halves_of_a_pair_tell_each_other_apart_by_the_plate_alone(name: str, site_of: SiteOf) -> None:
    site, root = site_of(name)
    signed, contrast = site.rows[:2]
    loader = loader_of(root)
    (a, _), (b, _) = loader.load(signed), loader.load(contrast)
    assert (a.target_signs[0].code, b.target_signs[0].code) == ("5.19", "3.24")
    assert b.target_signs[0].posted * KMH >= max(lane.speed for lane in b.network.edge_lanes("road.0")) - 0.15
    assert [replace(s, code="X", value=None, params=None) for s in a.signs] == [
        replace(s, code="X", value=None, params=None) for s in b.signs
    ]
    # At each crossing both directions have the same plate; at the second it is the other half's.
    for half, other in ((a, b), (b, a)):
        hung = {s.edge: (s.code, s.value) for s in half.signs[:4]}
        assert {hung["road.0"], hung["back.1"]} == {(half.target_signs[0].code, half.target_signs[0].value)}
        assert {hung["road.1"], hung["back.0"]} == {(other.target_signs[0].code, other.target_signs[0].value)}
    certifier = Certifier(simulation(), loader)
    proofs = certifier.compare([certifier.prove(row, "idm", 0, 0.0, 0.0) for row in (signed, contrast)])
    for row, proof in zip((signed, contrast), proofs, strict=True):
        assert proof.unpaired_because(row) == ""
        assert proof.exclusive
        assert proof.blind_equal
        assert proof.brake_mps2 > MAX_DECEL_MPS2


def test_people_of_a_contrast_half_stand_until_the_ego_is_past(site_of: SiteOf) -> None:
    site, root = site_of("two_way")
    for row in site.rows[:2]:
        facts = driven(row, root).facts
        assert facts is not None
        come_up = recipe_of("crosswalk").number("come_up_s")
        crossing = first_crossing(facts.scene.network)
        exit_ = frozenset(facts.scene.network.edges["road.1"].lanes)
        before = [s for s in facts.snapshots if s.ego.lane not in exit_]
        walk = [
            s.time for s in before[round(come_up / DT_S) + 2 :]
            if (s.actors.speed[s.actors.kind == ActorKind.PEDESTRIAN] > 0.1).any()
        ]  # fmt: skip
        assert bool(walk) == (row.half == SIGNED)
        last = before[-1].actors
        at = last.pose[last.kind == ActorKind.PEDESTRIAN][0, :2]
        ends = (crossing.line.points[0], crossing.line.points[-1])
        # It stands near its kerb, and is on the road where 5.19 stands.
        assert min(math.dist(at, end) for end in ends) < 2.0
    assert facts.snapshots[-1].actors.speed[facts.snapshots[-1].actors.kind == ActorKind.PEDESTRIAN].max() > 0.5


def test_pictures_show_the_zebra_and_the_people(site_of: SiteOf) -> None:
    site, root = site_of("two_way")
    row = site.rows[0]
    scene, _ = loader_of(root).load(row)
    assert scene.walkers is not None
    walkers = {body.name: (body.x, body.y) for body in staged_bodies(scene) if body.kind == "pedestrian"}
    assert set(walkers) == set(scene.walkers.persons)
    # Where the first tick of an episode sees them.
    facts = driven(row, root).facts
    first = facts.snapshots[0].actors
    seen = {first.table.ids[r]: p for r, p in zip(first.index.tolist(), first.pose.tolist(), strict=True)}
    for name, place in walkers.items():
        assert math.dist(seen[name][:2], place) < 0.3
    page = scene_picture(scene, "title").reshape(-1, 3)
    assert (page == STYLE.pedestrian).all(axis=1).any()
    unruled = tuple(replace(sign, params=None) for sign in scene.signs)
    plain = replace(scene, network=replace(scene.network, crossings={}), signs=unruled)
    bare = scene_picture(plain, "title").reshape(-1, 3)
    assert (page == STYLE.marking).all(axis=1).sum() > 1.2 * (bare == STYLE.marking).all(axis=1).sum()


CHILD = """
import sys
from pathlib import Path
sys.path[:0] = sys.argv[1:3]
from test_crosswalk_scenes import digest
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.sumo import Simulation
nan = float("nan")
print(digest(eval(sys.argv[4]), Path(sys.argv[3]), Simulation()))
"""


def digest(row: ScenarioSpec, root: Path, sim: Simulation) -> str:
    """What `idm-e` and everybody around it did, to the last bit."""
    facts = driven(row, root, "idm-e", sim).facts
    assert facts is not None
    found = hashlib.sha256()
    people = 0
    for s in facts.snapshots:
        found.update(repr(s.ego).encode() + s.actors.pose.tobytes() + s.actors.speed.tobytes())
        people += int(np.count_nonzero(s.actors.kind == ActorKind.PEDESTRIAN))
    assert people > 50
    return found.hexdigest()


def test_an_episode_with_people_is_the_same_in_two_processes(site_of: SiteOf) -> None:
    site, root = site_of("two_way")
    row = site.rows[2]
    here = [digest(row, root, simulation()) for _ in range(2)]
    paths = [str(p) for p in (Path(__file__).parent, Path(__file__).parents[2] / "helpers")]
    child = subprocess.run(
        [sys.executable, "-c", CHILD, *paths, str(root), repr(row)],
        capture_output=True, text=True, check=True, timeout=HANG_S,
        env={"PYTHONHASHSEED": "77", "PATH": "/usr/bin:/bin"},
    )  # fmt: skip
    assert {*here, child.stdout.split()[-1]} == {here[0]}
