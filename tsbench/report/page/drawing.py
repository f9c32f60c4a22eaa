"""Shapes as a bird's-eye view in a page takes them; `plate_of` gives the pictures of its plates.

The page's format is described in `static/bev.js`. Coordinates are whole tenths of a metre, each point but a shape's
first relative to the one before, so that they compress well. Units: m in the network's frame, rad.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import shapely

from tsbench.geometry.polyline import Array
from tsbench.report.drawing import main_road
from tsbench.report.drawing.shapes import Area, Body, DrawnPlate, Line, Shape, cone_places
from tsbench.signs.plates import plate_svg

UNIT_M = 0.1
_SIMPLER_M = 0.05


def drawing(shapes: Iterable[Shape]) -> dict[str, Any]:
    areas: list[dict[str, Any]] = []
    lines: list[dict[str, Any]] = []
    plates: list[dict[str, Any]] = []
    bodies: list[dict[str, Any]] = []
    for shape in shapes:
        match shape:
            case Area():
                rings = [r for p in _parts(shape.polygon) for r in (p.exterior, *p.interiors)]
                flat = [_flat(shapely.get_coordinates(ring)[:-1]) for ring in rings]
                _add(areas, {"c": shape.colour, "a": shape.opacity}, "r", flat)
            case Line():
                parts = _parts(shapely.LineString(shape.points))
                flat = [_flat(shapely.get_coordinates(part)) for part in parts]
                _add(lines, {"c": shape.colour, "w": shape.width, "a": 1.0}, "p", flat)
            case Body(kind="cones"):
                bodies += [_body("cone", x, y) for x, y in cone_places(shape).tolist()]
            case Body():
                bodies.append(_body(shape.kind, shape.x, shape.y, shape.heading, shape.length, shape.width))
            case DrawnPlate():
                plates.append({
                    "x": round(shape.x, 2), "y": round(shape.y, 2), "ax": round(float(shape.away[0]), 3),
                    "ay": round(float(shape.away[1]), 3), "clear": round(shape.clear, 1),
                    "plate": plate_key(shape.code, shape.value), "below": shape.below, "target": shape.target,
                })  # fmt: skip
    return {
        "unit": UNIT_M, "x0": 0, "y0": 0, "areas": areas, "lines": lines, "plates": plates, "bodies": bodies,
    }  # fmt: skip


def _parts(shape: shapely.Geometry) -> list[shapely.Geometry]:
    """The polygons or lines of a shape, as simple as the page's unit allows."""
    kind = "LineString" if shape.geom_type == "LineString" else "Polygon"
    parts = shapely.get_parts(shapely.simplify(shape, _SIMPLER_M))
    return [part for part in parts if part.geom_type == kind and not part.is_empty]


def _add(where: list[dict[str, Any]], look: dict[str, Any], key: str, shapes: list[list[int]]) -> None:
    """Shapes that look alike and follow each other are one."""
    if shapes and where and {k: v for k, v in where[-1].items() if k != key} == look:
        where[-1][key] += shapes
    elif shapes:
        where.append({**look, key: shapes})


def _body(kind: str, *numbers: float) -> dict[str, Any]:
    x, y, h, length, width = (round(v, 2) for v in (*numbers, 0.0, 0.0, 0.0)[:5])
    return {"c": kind, "x": x, "y": y, "h": h, "l": length, "w": width}


def plate_key(code: str, value: float | None) -> str:
    return code if value is None else f"{code}|{value:g}"


def plate_keys(drawing: dict[str, Any]) -> tuple[str, ...]:
    """Of all plates of a drawing, with those that hang beneath others."""
    keys = (plate[name] for plate in drawing["plates"] for name in ("plate", "below"))
    return tuple(dict.fromkeys(key for key in keys if key))


def plate_of(key: str) -> str:
    """A plate's picture as SVG. Raises InputError or ValueError for a key that names none."""
    code, bar, value = key.partition("|")
    if code == main_road.CODE:
        return main_road.MainRoad.of(key).svg()
    return plate_svg(code, float(value) if bar else None)


def _flat(points: Array) -> list[int]:
    """Whole tenths of a metre: the first point, then steps."""
    whole = np.rint(points / UNIT_M).astype(np.int64)
    steps: list[int] = np.diff(whole, axis=0, prepend=0).ravel().tolist()
    return steps
