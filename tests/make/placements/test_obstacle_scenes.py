"""Detours and closed roads: how their scenes are laid out, what traffic makes of them, how an episode ends there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from lxml import etree
from pool_builders import Networks, built_site, corridor, crossroads, halves_of, recipe_of, scene_task, signed_half
from simworld import LIMIT, cross_plain, driven, loader_of, road_plain

from tsbench.episode.outcome import Contact, Outcome
from tsbench.episode.trace import Trace, read_trace, write_trace
from tsbench.make.maps.netconvert import build_net
from tsbench.make.maps.plain import PlainNet
from tsbench.make.placements.by_name import placement_of
from tsbench.make.placements.placement import Arrangement, SceneTask, UnfitMapError
from tsbench.make.scenes.recipe import Variant, variants_of
from tsbench.make.scenes.verify import lint_scene
from tsbench.roads.lane_graph import LaneGraph
from tsbench.roads.network import read_network
from tsbench.run.log.record import Row, score
from tsbench.run.rescore import Judge
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.map_pool import PoolRow
from tsbench.scenarios.spec import SIGNED, ScenarioSpec
from tsbench.signs.annotations import DISTRACTOR
from tsbench.signs.contrast import PassageParams, WayParams
from tsbench.sim.scene_file import read_additional
from tsbench.sim.world import EGO_LENGTH_M

LAYOUTS = range(6)
DETOURS = ("detour_right", "detour_left", "detour_either")
ROAD: tuple[PoolRow, PlainNet] = (corridor(speed=LIMIT), road_plain())
MAPS = {**dict.fromkeys(DETOURS, ROAD), "blocked_road": (crossroads(), cross_plain())}


def task_of(networks: Networks, type_id: str, layout: int) -> SceneTask:
    variant = Variant(1, 90.0, 4.0, 7.75, 0, layout)
    return scene_task(MAPS[type_id][0], networks[type_id], recipe_of(type_id), variant, seed=layout)


def place(networks: Networks, type_id: str, layout: int) -> Arrangement:
    return signed_half(task_of(networks, type_id, layout))


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("type_id", DETOURS)
def test_detour(networks: Networks, type_id: str, layout: int) -> None:
    network, recipe = networks[type_id], recipe_of(type_id)
    a = place(networks, type_id, layout)
    thing, *passed = a.obstacles
    # The middle one of three, which has a lane for cars on both sides, whatever the plate says.
    assert thing.lane == a.start.lane == "road_1"
    lane = network.lane(thing.lane)
    s, d = lane.line.project(thing.x, thing.y)
    assert d == pytest.approx(0.0, abs=0.01)
    ahead = s - thing.length / 2 - a.start.s - EGO_LENGTH_M / 2
    assert ahead == pytest.approx(recipe.number("ego_before_obstacle_m"), abs=0.01)
    sign = a.signs[0]
    assert (sign.code, sign.lane, sign.params.obstacle) == (recipe.type.codes[0], 1, thing.id)
    assert sign.position_m == pytest.approx(s - thing.length / 2)
    assert a.destination.s > s + thing.length / 2 + 20.0
    # No car stands between the ego and the obstacle, in it, or with its tail in it.
    ((name, begin, end),) = a.blocked
    assert (name, begin) == (thing.lane, a.start.s)
    assert end > s + thing.length / 2 + 8.5
    shapes = recipe.choices["obstacles"]
    assert thing.shape == shapes[layout % len(shapes)]["shape"]
    # Where there is a contrast half, the ego has passed another obstacle, and no other vehicle passes either.
    assert (len(passed) == 1) == recipe.paired == bool(a.closed_edges)
    for other in passed:
        end = lane.line.project(other.x, other.y)[0] + other.length / 2
        assert end + recipe.number("passed_before_ego_m") <= a.start.s - EGO_LENGTH_M / 2


@pytest.mark.parametrize(("type_id", "code"), [("detour_right", "4.2.2"), ("detour_left", "4.2.1")])
def test_the_contrast_half_of_a_detour_exchanges_the_plates_of_two_obstacles(
    networks: Networks, type_id: str, code: str
) -> None:
    signed, contrast = halves_of(task_of(networks, type_id, 1))
    target, other = signed.signs
    assert (other.code, other.role, other.params) == (code, DISTRACTOR, None)
    plates = (replace(target, code=code), replace(other, code=target.code))
    assert contrast == replace(signed, signs=plates)


def test_what_allows_both_sides_has_no_contrast_half(networks: Networks) -> None:
    task = task_of(networks, "detour_either", 1)
    placement = placement_of(task.recipe)
    assert not task.recipe.paired
    assert placement.contrast(task, placement.place(task)) is None


@pytest.mark.parametrize("type_id", DETOURS)
def test_a_road_of_two_lanes_takes_no_detour(type_id: str) -> None:
    recipe = recipe_of(type_id)
    with pytest.raises(UnfitMapError, match="2 lanes"):
        placement_of(recipe).prepare(corridor(lanes=2), road_plain(lanes=2), recipe)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_blocked_road(networks: Networks, layout: int) -> None:
    network, recipe = networks["blocked_road"], recipe_of("blocked_road")
    graph, a = LaneGraph(network), place(networks, "blocked_road", layout)
    lane, (sign, other) = network.lane(a.start.lane), a.signs
    assert lane.edge in ("w_in", "e_in")
    front = lane.line.length - a.start.s - EGO_LENGTH_M / 2
    assert front == pytest.approx(recipe.number("ego_before_line_m"))
    closed = sign.edge
    assert a.route_hint == (lane.edge, closed)
    assert (sign.code, sign.position_m) == ("3.2", recipe.number("plate_after_junction_m"))
    # Beyond the plate nothing but the plate says that the road is closed.
    assert a.obstacles == ()
    assert a.destination.edge == closed
    assert a.destination.s >= sign.position_m + recipe.number("destination_behind_plate_m")
    # The other post stands at the mouth of another exit.
    assert (other.code, other.role, other.position_m) == ("3.24", DISTRACTOR, sign.position_m)
    assert other.edge in set(graph.successors(lane.edge)) - {closed}
    # Nobody else drives into either arm or out of it, and every other arm still has somewhere to go.
    exits = {closed, other.edge}
    assert a.closed_edges == exits | {e.replace("out", "in") for e in exits}
    assert a.avoid_turns == {(e, x) for x in exits for e in network.edges if x in graph.successors(e)}
    for arm in "wesn":
        if f"{arm}_in" not in a.closed_edges:
            assert set(graph.successors(f"{arm}_in")) - exits


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_contrast_half_of_a_blocked_road_exchanges_its_plates(networks: Networks, layout: int) -> None:
    task = task_of(networks, "blocked_road", layout)
    signed, a = halves_of(task)
    assert replace(a, signs=signed.signs, targets=signed.targets, contrast=()) == signed
    posts = [[(s.x, s.y, s.heading) for s in half.signs] for half in (signed, a)]
    assert posts[0] == posts[1]
    assert [s.code for s in a.signs] == ["3.24", "3.2"]
    target = next(s for s in a.signs if s.id == a.targets[0])
    # It closes the other exit, and does not bind the ego.
    assert (target.code, target.edge, target.params) == ("3.2", signed.signs[1].edge, None)
    assert target.edge not in a.route_hint
    approach, exit_ = a.route_hint
    clauses = {c.name: c.params for c in a.contrast}
    oncoming = {"w_in": "e_in", "e_in": "w_in"}[approach]
    left = task.graph.turn(approach, exit_) == "left"
    assert clauses == {
        "needless_stop": PassageParams(approach, exit_, (oncoming,) if left else ()),
        "needless_detour": WayParams(approach, (exit_,)),
    }


def test_the_closed_exit_varies(networks: Networks) -> None:
    hints = {place(networks, "blocked_road", layout).route_hint for layout in LAYOUTS}
    assert len(hints) == 6


def test_an_exit_that_is_short_or_one_of_two_is_not_closed(networks: Networks, tmp_path: Path) -> None:
    recipe, (row, crop) = recipe_of("blocked_road"), MAPS["blocked_road"]
    short = replace(recipe, numbers={**recipe.numbers, "least_exit_m": 500})
    # A main road with nothing but a one-way street into it: who drives along it can't leave it.
    arms = [
        {**a, "out_edge": a["out_edge"] if a["in_edge"] != "s_in" else ""}
        for a in row.fields["arms"]
        if a["in_edge"] != "n_in"
    ]
    edges = tuple(e for e in crop.edges if e.id not in ("n_in", "n_out", "s_out"))
    street = replace(crop, edges=edges, nodes=tuple(n for n in crop.nodes if n.id != "n"))
    lonely = crossroads(arms=arms, through=[[0, 1]])
    net = tmp_path / "street.net.xml.gz"
    build_net(placement_of(recipe).prepare(lonely, street, recipe), net)
    for one, network, numbers in ((row, networks["blocked_road"], short), (lonely, read_network(net), recipe)):
        task = scene_task(one, network, numbers, variants_of("t", "m")[1])
        with pytest.raises(UnfitMapError, match="no way from the main road into an exit that could be closed"):
            signed_half(task)


Site = tuple[Path, dict[str, tuple[ScenarioSpec, ...]]]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Site:
    """Variant 0 and one in thin traffic of every type here, signed, by type, from the hand-made maps."""
    root, rows = tmp_path_factory.mktemp("sites"), {}

    for type_id, made in MAPS.items():
        site = built_site(recipe_of(type_id), root, made, lambda variants: [v for v in variants if v.density < 3.0][:2])
        assert site.reason == ""
        rows[type_id] = tuple(r for r in site.rows if r.half == SIGNED)
    return root, rows


def routes_of(root: etree._Element) -> list[list[str]]:
    """The ways of the background cars."""
    cars = [v for v in root.iterfind("vehicle") if str(v.attrib["id"]).startswith("bg_")]
    return [str(v.find("route").attrib["edges"]).split() for v in cars]  # type: ignore[union-attr]


def test_scenes_are_sound_and_nobody_else_enters_the_closed_road(site: Site) -> None:
    root, rows = site
    for type_id, specs in rows.items():
        for spec in specs:
            scene, roads = loader_of(root).load(spec)
            assert list(lint_scene(scene, roads.graph)) == []
            if type_id == "blocked_road" and spec.variant:
                closed = {scene.target_signs[0].edge, scene.target_signs[0].edge.replace("out", "in")}
                ways = routes_of(read_additional(scene.additional.path, scene.additional.content))
                assert len(ways) > 5
                assert not [way for way in ways if closed & set(way)]


def drive(root: Path, spec: ScenarioSpec, planner: str, folder: Path) -> tuple[Trace, Row, list[Row]]:
    """An episode's trace, and its row and events as a run records them."""
    result = driven(spec, root, planner)
    assert result.facts is not None, result.error
    row, events = score(spec, planner, False, result.facts)
    write_trace(folder / "trace.parquet", result)
    return read_trace(folder / "trace.parquet"), row, events


@pytest.mark.parametrize("type_id", MAPS)
@pytest.mark.parametrize("variant", [0, 1])
def test_the_expert_obeys_and_the_sign_blind_driver_does_not_arrive(
    site: Site, type_id: str, variant: int, tmp_path: Path
) -> None:
    root, rows = site
    spec = rows[type_id][variant]
    _, calm, _ = drive(root, spec, "idm-e", tmp_path)
    assert (calm["outcome"], calm["scd"], calm["sign_engaged"]) == ("arrived", True, True)
    assert calm["route_completion"] == 100.0
    _, blind, _ = drive(root, spec, "idm", tmp_path)
    assert (blind["scd"], blind["sign_engaged"]) == (False, True)
    if type_id == "blocked_road":
        assert blind["violation_clause"] == "entered_closed_road"


def test_a_held_stop_is_judged_alike_from_the_trace(
    site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root, rows = site
    spec = rows["blocked_road"][1]
    trace, row, events = drive(root, spec, "idm-e", tmp_path)
    # Three seconds still, and not a tick longer than it takes.
    speeds = [s.ego.speed for s in trace.snapshots]
    assert max(speeds[-31:]) <= 0.5 < speeds[-32]
    judge = Judge(DataSet())
    monkeypatch.setattr(judge, "_loader", loader_of(root))
    key = ("idm-e", spec.scenario_id)
    assert list(judge.compare(trace, key, row, events)) == []
    # A trace that is cut off before the stop is complete, or says more than happened, does not pass.
    parked = replace(trace, snapshots=trace.snapshots[:-1])
    assert any(line.startswith("outcome is arrived") for line in judge.compare(parked, key, row, events))
    hit = replace(trace, outcome=Outcome.COLLISION, contact=Contact(3, "vehicle", "bg_000", True))
    wrong = {**row, "outcome": "collision"}
    assert any("judged again arrived" in line for line in judge.compare(hit, key, wrong, events))
