"""Roads as they are drawn, and the buildings and greenery beside them."""

from __future__ import annotations

import math
from dataclasses import replace

import episode_builders as made
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from tsbench.geometry.polyline import Polyline
from tsbench.report.drawing.canvas import STYLE, Area, lane_area, rounded, rounded_along
from tsbench.report.drawing.hud import _plain
from tsbench.report.drawing.road_shapes import ground_shapes, mark_shapes, road_shapes
from tsbench.report.drawing.scene_shapes import tick_shapes
from tsbench.report.page.page_format import drawing
from tsbench.report.scene_pictures import scene_picture
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader, load_scene
from tsbench.sim.world import DT_S, ActorKind, Actors, ActorTable, EgoState, WorldSnapshot

places = st.tuples(st.floats(-40, 40), st.floats(-40, 40))


@given(st.lists(places, min_size=2, max_size=8, unique=True))
def test_a_rounded_line_begins_and_ends_where_the_line_does_and_stays_near_it(
    points: list[tuple[float, float]],
) -> None:
    steps = np.hypot(*np.diff(np.array(points), axis=0).T)
    if steps.min() < 0.5:
        return
    line = Polyline(np.array(points))
    curve = rounded(line).points
    assert np.array_equal(curve[[0, -1]], line.points[[0, -1]])
    away = [abs(line.project(x, y)[1]) for x, y in curve.tolist()]
    assert max(away) < 3.0


def test_a_corner_becomes_a_curve_and_a_hairpin_stays() -> None:
    corner = rounded(Polyline(np.array([(0.0, 0.0), (20.0, 0.0), (20.0, 20.0)])))
    headings = np.arctan2(*np.diff(corner.points, axis=0).T[::-1])
    assert np.abs(np.diff(headings)).max() < math.radians(13.0)
    back = Polyline(np.array([(0.0, 0.0), (20.0, 0.0), (1.0, 2.0)]))
    assert np.array_equal(rounded(back).points, back.points)
    straight = Polyline(np.array([(0.0, 0.0), (10.0, 0.0), (20.0, 0.0)]))
    assert np.array_equal(rounded(straight).points, straight.points)
    assert lane_area(straight, 3.0).area == pytest.approx(60.0)


def test_lanes_before_a_fork_say_where_they_lead() -> None:
    """Of `yield`, whose arm ends at a junction with two ways; a road without one has no arrow unless it is one-way."""
    rows = {row.scenario_type: row for row in DataSet().table("dev") if row.half == "signed"}
    loader = SceneLoader(DataSet())

    def heads(kind: str, *, plates: bool = True) -> int:
        scene, _ = loader.load(rows[kind])
        shapes = [*road_shapes(scene.network), *mark_shapes(scene.network, scene if plates else None)]
        found = [s.polygon for s in shapes if isinstance(s, Area) and s.colour == "marking"]
        return sum(len(one.exterior.coords) == 4 for one in found)

    assert heads("yield") >= 4
    assert heads("speed_limit") == 0
    # At a junction whose plate says which ways are open, none contradicts the plate of either half.
    for kind in ("no_turn_left", "one_way_left", "no_entry"):
        assert heads(kind) < heads(kind, plates=False)


def test_a_one_way_road_says_again_and_again_which_way_it_goes() -> None:
    """The made road has two directions; without the other one its two lanes of 500 m are one-way."""
    road = made.road()
    alone = replace(road, edges={"east": road.edges["east"]})

    def fronts(length: float) -> list[float]:
        lanes = tuple(replace(one, line=one.line.slice(0.0, length), length=length) for one in road.lanes[:2])
        heads = [
            s.polygon.exterior.coords[0]
            for s in road_shapes(replace(alone, lanes=(*lanes, *road.lanes[2:])))
            if isinstance(s, Area) and s.colour == "marking"
        ]
        return sorted(x for x, y in heads if y < -3.2)

    long = fronts(500.0)
    assert len(long) == 14
    assert 30.0 < min(np.diff(long)) <= max(np.diff(long)) < 40.0
    assert len(fronts(12.0)) == 1
    assert fronts(8.0) == []
    # Whatever their nodes are called: beside them runs a road back.
    assert not any(isinstance(s, Area) and s.colour == "marking" for s in road_shapes(road))


def test_a_lane_that_ends_beside_others_is_left_to_their_side() -> None:
    rows = {row.scenario_type: row for row in DataSet().table("dev")}
    scene, _ = SceneLoader(DataSet()).load(rows["bus_lane_road"])
    lanes = scene.network.edge_lanes(scene.route_hint[0])
    ends, leads = lanes[-1], lanes[0]
    assert (scene.start.lane, len(scene.network.outgoing[ends.index])) == (ends.id, 0)
    for lane, aside in ((ends, True), (leads, False)):
        area = lane_area(lane.line, lane.width)
        heads = [s.polygon for s in road_shapes(scene.network) if isinstance(s, Area) and s.colour == "marking"]
        beside = [lane.line.project(*head.exterior.coords[0])[1] for head in heads if area.contains(head.centroid)]
        assert [at < -0.3 for at in beside] == [aside] * max(len(beside), 1)


def test_brake_lights_are_on_while_somebody_slows_down() -> None:
    table = ActorTable()
    row = table.add("car", ActorKind.CAR, 5.0, 1.8, ("e",))
    ego = EgoState(0.0, 0.0, 0.0, 10.0, 0.0, 0.0, 0.0, -1, 0.0, 0.0, True)

    def at(step: int, speed: float) -> WorldSnapshot:
        car = Actors(
            table, np.array([row], dtype=np.int32), np.array([[9.0, 0.0, 0.0]]), np.array([speed]),
            np.array([0], dtype=np.int32), np.array([0.0]),
        )  # fmt: skip
        return WorldSnapshot(step, step * DT_S, replace(ego, speed=speed), car)

    for slower, brakes in ((0.5 * DT_S, False), (1.5 * DT_S, True), (-2.0, False)):
        assert [body.brakes for body in tick_shapes(at(1, 10.0 - slower), at(0, 10.0))] == [brakes, brakes]
    assert [body.brakes for body in tick_shapes(at(0, 10.0))] == [False, False]


def test_what_rounds_to_nothing_has_no_sign() -> None:
    assert (_plain(-0.04), _plain(-0.06), _plain(2.25)) == ("0.0", "-0.1", "2.2")


def test_places_along_a_rounded_line_are_those_of_the_line_where_it_is_straight() -> None:
    line = Polyline(np.array([(0.0, 0.0), (40.0, 0.0), (40.0, 40.0)]))
    s, points = rounded_along(line, 1.0)
    assert s[0] == 0.0
    assert s[-1] == line.length
    away = [float(np.hypot(*(np.array(line.point_at(at)) - point))) for at, point in zip(s, points, strict=True)]
    straight = np.abs(s - 40.0) > 8.0
    assert max(np.array(away)[straight]) == pytest.approx(0.0, abs=1e-9)
    assert 0.5 < max(away) < 3.0


def test_buildings_stand_beside_the_roads() -> None:
    """Of a shipped city: were its file in another frame, houses would stand on lanes."""
    data = DataSet("north-bayreuth")
    rows = {row.map_id: row for row in data.table("dev")}
    on_roads = houses = 0.0
    for row in rows.values():
        scene = load_scene(data, row)
        built = [one.polygon for one in ground_shapes(scene, row.map_id) if one.colour == "building"]
        shapes = list(road_shapes(scene.network))
        asphalt = shapely.union_all([s.polygon for s in shapes if isinstance(s, Area) and s.colour == "asphalt"])
        houses += sum(shape.area for shape in built)
        on_roads += sum(shape.intersection(asphalt).area for shape in built)
    assert houses > 1_000.0
    assert on_roads < 0.01 * houses


def test_a_mirror_turns_them_and_moscow_has_none() -> None:
    data, image = DataSet("north-bayreuth"), DataSet("north-bayreuth", mirrored=True)
    row, scene = next(
        (row, scene)
        for row in data.table("dev")
        for scene in [load_scene(data, row)]
        if ground_shapes(scene, row.map_id)
    )
    own = ground_shapes(scene, row.map_id)
    page = scene_picture(scene, "title", map_id=row.map_id)
    bare = scene_picture(scene, "title")
    turned = ground_shapes(load_scene(image, image.table("dev")[0]), row.map_id)
    for one, other in zip(own, turned, strict=True):
        left, low, right, high = one.polygon.bounds
        assert other.polygon.bounds == (-right, low, -left, high)
        assert other.colour == one.colour
    assert ground_shapes(load_scene(DataSet(), DataSet().table("dev")[0]), row.map_id) == ()
    # It is in pictures, and pages take the same shapes.
    colour = np.array(getattr(STYLE, own[-1].colour))
    assert (page == colour).all(axis=2).any()
    assert not (bare == colour).all(axis=2).any()
    assert {area["c"] for area in drawing(own)["areas"]} == {one.colour for one in own}
