"""What a bird's-eye view in a page shows and does not move: roads, furniture, anything made of areas and lines.

The page's format is described in `static/bev.js`. Coordinates are whole tenths of a metre, each point but a shape's
first relative to the one before, so that they compress well. Units: m in the network's frame, rad.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely

from tsbench.geometry.polyline import Array
from tsbench.maps.network import RoadNetwork
from tsbench.report.places import destination_place, plate_line, way_off, way_points
from tsbench.report.roads import Area, road_paint
from tsbench.report.staging import staged_cars, walker_places
from tsbench.report.zone import rule_zone
from tsbench.signs.annotations import SignInstance
from tsbench.signs.plates import plate_svg
from tsbench.sim.lanegraph import LaneGraph
from tsbench.sim.scene import Obstacle, Scene
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M

UNIT_M = 0.1
_SIMPLER_M = 0.05
# left, bottom, right, top
Box = tuple[float, float, float, float]


class Drawing:
    """Collects shapes; lowest first. within: what lies outside this box is cut off."""

    def __init__(self, within: Box | None = None) -> None:
        self._within = within
        self._areas: list[dict[str, Any]] = []
        self._lines: list[dict[str, Any]] = []
        self._plates: list[dict[str, Any]] = []
        self._bodies: list[dict[str, Any]] = []

    def area(self, colour: str, shape: shapely.Geometry, opacity: float = 1.0) -> None:
        """Fill polygons; colour: a field of `report.style.Style`."""
        if self._within is not None:
            shape = shapely.clip_by_rect(shape, *self._within)
        parts = [
            p for p in shapely.get_parts(shapely.simplify(shape, _SIMPLER_M)) if p.geom_type == "Polygon"
        ]
        rings = [
            _flat(shapely.get_coordinates(r)[:-1])
            for p in parts
            for r in (p.exterior, *p.interiors)
            if not p.is_empty
        ]
        if rings:
            self._add(self._areas, {"c": colour, "a": opacity}, "r", rings)

    def line(self, colour: str, points: Array, width: float, opacity: float = 1.0) -> None:
        """An open line (n, 2); width in m."""
        if len(points) < 2:
            return
        shape = shapely.simplify(shapely.LineString(points), _SIMPLER_M)
        if self._within is not None:
            shape = shapely.clip_by_rect(shape, *self._within)
        lines = [_flat(shapely.get_coordinates(p)) for p in shapely.get_parts(shape) if not p.is_empty]
        if lines:
            self._add(self._lines, {"c": colour, "w": width, "a": opacity}, "p", lines)

    def plate(self, sign: SignInstance, network: RoadNetwork, target: bool) -> None:
        """A plate beside its post; `plates_of` gives its picture."""
        away, clear = way_off(network, sign)
        self._plates.append({
            "x": round(sign.x, 2), "y": round(sign.y, 2), "ax": round(float(away[0]), 3),
            "ay": round(float(away[1]), 3), "clear": round(clear, 1), "plate": plate_key(sign.code, sign.value),
            "target": target,
        })  # fmt: skip

    def body(
        self, kind: str, x: float, y: float, heading: float = 0.0, length: float = 0.0, width: float = 0.0
    ) -> None:
        """Something that stands: a kind of `bev.js`, its centre and size."""
        numbers = {"x": x, "y": y, "h": heading, "l": length, "w": width}
        self._bodies.append({"c": kind, **{k: round(v, 2) for k, v in numbers.items()}})

    def to_json(self) -> dict[str, Any]:
        """The drawing as the page takes it."""
        return {
            "unit": UNIT_M, "x0": 0, "y0": 0, "areas": self._areas, "lines": self._lines,
            "plates": self._plates, "bodies": self._bodies,
        }  # fmt: skip

    @staticmethod
    def _add(where: list[dict[str, Any]], look: dict[str, Any], key: str, shapes: list[list[int]]) -> None:
        """Shapes that look alike and follow each other are one."""
        if where and {k: v for k, v in where[-1].items() if k != key} == look:
            where[-1][key] += shapes
        else:
            where.append({**look, key: shapes})


def roads_drawing(network: RoadNetwork, within: Box | None = None) -> dict[str, Any]:
    """Pavements, carriageways and markings."""
    drawing = Drawing(within)
    for part in road_paint(network):
        if isinstance(part, Area):
            drawing.area(part.colour, part.shape)
        else:
            drawing.line(part.colour, part.points, part.width)
    return drawing.to_json()


def scene_drawing(scene: Scene, graph: LaneGraph, staged: bool = False) -> dict[str, Any]:
    """What a scene puts on the roads: destination, the rule's zone, ways, the target's line, obstacles, plates.

    staged: also the ego, the cars and the pedestrians where they start, for a scene without an episode.
    """
    drawing = Drawing()
    zone = rule_zone(scene)
    if zone is not None:
        drawing.area("plate_line", zone, 0.22)
    strips, middle = destination_place(scene)
    drawing.area("destination", strips, 0.6)
    drawing.area("destination", shapely.Point(middle).buffer(1.2), 0.9)
    if scene.compliant_hint and scene.compliant_hint != scene.route_hint:
        drawing.line("compliant", way_points(scene, graph, scene.compliant_hint, -0.4), 0.3, 0.7)
    drawing.line(
        "route", way_points(scene, graph, scene.route_hint, 0.4 if scene.compliant_hint else 0.0), 0.3, 0.7
    )
    drawing.line("plate_line", plate_line(scene.network, scene.target_sign), 0.3)
    for obstacle in scene.obstacles:
        _obstacle(drawing, obstacle)
    for sign in scene.signs:
        drawing.plate(sign, scene.network, sign.id == scene.target)
    if staged:
        _staged(drawing, scene)
    return drawing.to_json()


def _obstacle(drawing: Drawing, o: Obstacle) -> None:
    if o.shape != "cones":
        drawing.body("island", o.x, o.y, o.heading, o.length, o.width)
        return
    for along in np.linspace(-0.5, 0.5, max(round(o.length / 1.5), 2)) * (o.length - 0.4):
        drawing.body("cone", o.x + along * np.cos(o.heading), o.y + along * np.sin(o.heading))


def _staged(drawing: Drawing, scene: Scene) -> None:
    for car in staged_cars(scene):
        drawing.body("convoy" if car.held else "car", car.x, car.y, car.heading, car.length, car.width)
    for x, y in walker_places(scene):
        drawing.body("pedestrian", x, y)
    line = scene.network.lane(scene.start.lane).line
    drawing.body(
        "ego", *line.point_at(scene.start.s), line.heading_at(scene.start.s), EGO_LENGTH_M, EGO_WIDTH_M
    )


def plate_key(code: str, value: float | None) -> str:
    """The key of a plate's picture in a page."""
    return code if value is None else f"{code}|{value:g}"


def plates_of(signs: tuple[SignInstance, ...]) -> dict[str, str]:
    """The pictures of plates as SVG documents, by key."""
    return {plate_key(s.code, s.value): plate_svg(s.code, s.value) for s in signs}


def box_around(points: Array, room: float) -> Box:
    """The box of points (n, 2) with room around them, in m."""
    low, high = points.min(axis=0) - room, points.max(axis=0) + room
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _flat(points: Array) -> list[int]:
    """Whole tenths of a metre: the first point, then steps."""
    whole = np.rint(points / UNIT_M).astype(np.int64)
    steps: list[int] = np.diff(whole, axis=0, prepend=0).ravel().tolist()
    return steps
