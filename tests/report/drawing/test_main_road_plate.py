"""Plate 8.13 as a picture, and what plates of priority have painted."""

from __future__ import annotations

from dataclasses import replace

import pytest
import shapely
from lxml import etree

from tsbench.report.drawing.canvas import Area, DrawnPlate, Line
from tsbench.report.drawing.road_shapes import main_road_rgba, main_road_svg, mark_shapes, stop_lines
from tsbench.report.drawing.scene_shapes import furniture_shapes
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.main_road import MainRoad, main_roads
from tsbench.sim.scene import Scene

LOADER = SceneLoader(DataSet())


@pytest.fixture(scope="module")
def rows() -> dict[tuple[str, str], ScenarioSpec]:
    """The first row of each type and half."""
    table = DataSet().table("dev")
    return {(row.scenario_type, row.half): row for row in reversed(table) if row.half}


def scene_of(rows: dict[tuple[str, str], ScenarioSpec], kind: str, half: str) -> Scene:
    scene, _ = LOADER.load(rows[kind, half])
    return scene


def test_the_plate_is_drawn_beneath_the_plate_of_priority(rows: dict[tuple[str, str], ScenarioSpec]) -> None:
    scene = scene_of(rows, "main_road", "signed")
    target = main_roads(scene.network, scene.signs)[scene.targets[0]]
    plates = {shape.name: shape for shape in furniture_shapes(scene) if isinstance(shape, DrawnPlate)}
    assert plates[scene.targets[0]].below == target.key


def test_lines_lie_where_the_plates_put_them(rows: dict[tuple[str, str], ScenarioSpec]) -> None:
    """The same junctions with the plates of both halves."""
    asked = {**dict.fromkeys(("2.1", "2.3.1", "2.3.2", "2.3.3")), "2.4": "give_way", "2.5": "stop"}
    seen = set()
    for kind in ("main_road", "yield", "stop", "secondary_road"):
        for half in ("signed", "contrast"):
            if (kind, half) not in rows:
                continue
            scene = scene_of(rows, kind, half)
            lines = stop_lines(scene.network, scene.signs)
            for sign in (s for s in scene.signs if s.code in asked):
                seen.add(sign.code)
                for index in scene.network.edges[sign.edge].lanes:
                    assert lines.get(index) == asked[sign.code], (kind, half, sign.code)
    assert seen > {"2.1", "2.4", "2.5"}


def test_a_crossing_has_stripes_where_its_plate_stands(rows: dict[tuple[str, str], ScenarioSpec]) -> None:
    scene = scene_of(rows, "crosswalk", "signed")
    assert any(isinstance(shape, Area) for shape in mark_shapes(scene.network, scene))
    others = tuple(replace(sign, code="3.24", params=None) for sign in scene.signs)
    bare = list(mark_shapes(scene.network, replace(scene, signs=others)))
    assert not any(isinstance(shape, Area) for shape in bare)
    # Without plates the road's lines go on over both crossings.
    there = [shapely.LineString(shape.points) for shape in bare if isinstance(shape, Line)]
    for crossing in scene.network.crossings.values():
        over = shapely.LineString(crossing.line.points)
        assert sum(line.crosses(over) for line in there) >= 4


def test_the_plate_is_a_picture_of_its_roads() -> None:
    road = MainRoad((180, -90), (0, 90))
    assert etree.fromstring(main_road_svg(road.key)).get("viewBox") == "0 0 200 200"
    pixels = main_road_rgba(road.key, 100)
    ink = pixels[..., :3].astype(int).sum(axis=2) < 200
    # Thick from below and to the right, thin ahead and to the left.
    assert ink[70, 20:80].sum() > 2 * ink[30, 20:80].sum() > 0
    assert ink[20:80, 70].sum() > 2 * ink[20:80, 30].sum() > 0


def test_the_reserved_lane_is_the_plates_in_each_half(rows: dict[tuple[str, str], ScenarioSpec]) -> None:
    """In both halves two lanes are closed to cars; each half's plate reserves another one."""
    found = []
    for half in ("signed", "contrast"):
        scene = scene_of(rows, "bus_lane", half)
        (area,) = (
            s.polygon for s in mark_shapes(scene.network, scene) if isinstance(s, Area) and s.colour == "reserved"
        )
        found.append(area)
        assert not any(isinstance(s, Area) and s.colour == "reserved" for s in mark_shapes(scene.network))
    assert found[0].area > 100.0
    assert found[0].intersection(found[1]).area == 0.0
