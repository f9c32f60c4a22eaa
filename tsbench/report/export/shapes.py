"""Primitives of Foxglove's 3D scenes from poses, lanes and colours. Units: m, rad."""

from __future__ import annotations

import math

import numpy as np
from foxglove.messages import (
    Color,
    CubePrimitive,
    LinePrimitive,
    LinePrimitiveLineType,
    Point3,
    Pose,
    Quaternion,
    TextPrimitive,
    TriangleListPrimitive,
    Vector3,
)

from tsbench.geometry.polyline import Array
from tsbench.maps.network import Lane
from tsbench.report.style import Colour

_ROAD_Z, _LINE_Z, _PLATE_Z = 0.0, 0.03, 2.0
_PLATE_M = (0.1, 0.7, 0.7)
_LETTER_M = 1.2


def colour(rgb: Colour) -> Color:
    """Opaque, 0-1."""
    red, green, blue = (channel / 255 for channel in rgb)
    return Color(r=red, g=green, b=blue, a=1.0)


def turned(heading: float) -> Quaternion:
    """A turn about the vertical."""
    return Quaternion(x=0.0, y=0.0, z=math.sin(heading / 2), w=math.cos(heading / 2))


def pose(x: float, y: float, heading: float, z: float = 0.0) -> Pose:
    """A pose on the plane, lifted by z."""
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=turned(heading))


def box(x: float, y: float, heading: float, size: tuple[float, float, float], rgb: Colour) -> CubePrimitive:
    """A box that stands on the ground; size: length, width, height."""
    length, width, height = size
    return CubePrimitive(
        pose=pose(x, y, heading, height / 2), size=Vector3(x=length, y=width, z=height), color=colour(rgb)
    )


def surface(lanes: list[Lane], rgb: Colour) -> TriangleListPrimitive:
    """The lanes' strips, two triangles for each piece of their lines."""
    points: list[Point3] = []
    for lane in lanes:
        left, right = lane.line.beside(lane.width / 2), lane.line.beside(-lane.width / 2)
        a, b, c, d = left[:-1], right[:-1], right[1:], left[1:]
        corners = np.stack((a, b, c, a, c, d), axis=1).reshape(-1, 2)
        points += [Point3(x=x, y=y, z=_ROAD_Z) for x, y in corners.tolist()]
    return TriangleListPrimitive(pose=pose(0.0, 0.0, 0.0), points=points, color=colour(rgb))


def line(points: Array, rgb: Colour, thickness: float, closed: bool = False) -> LinePrimitive:
    """A line on the road."""
    return LinePrimitive(
        type=LinePrimitiveLineType.LineLoop if closed else LinePrimitiveLineType.LineStrip,
        pose=pose(0.0, 0.0, 0.0), thickness=thickness, color=colour(rgb),
        points=[Point3(x=x, y=y, z=_LINE_Z) for x, y in points.tolist()],
    )  # fmt: skip


def plate(x: float, y: float, heading: float, rgb: Colour) -> CubePrimitive:
    """A plate on its post, facing the traffic that comes along `heading`."""
    length, width, height = _PLATE_M
    return CubePrimitive(
        pose=pose(x, y, heading, _PLATE_Z), size=Vector3(x=length, y=width, z=height), color=colour(rgb)
    )


def lettering(x: float, y: float, text: str, rgb: Colour) -> TextPrimitive:
    """A text over a plate that turns to the camera."""
    return TextPrimitive(
        pose=pose(x, y, 0.0, _PLATE_Z + 1.0),
        billboard=True,
        font_size=_LETTER_M,
        color=colour(rgb),
        text=text,
    )
