"""Shapes of pictures, for every painter, and the curves of roads. Units: m, rad, in the network's frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely

from tsbench.geometry.polyline import Array, Polyline
from tsbench.signs.countries import Country


@dataclass(frozen=True, slots=True)
class Area:
    """A filled surface. colour: a field of `Style`, which names what it is; polygon: any number of them, with holes."""

    colour: str
    polygon: shapely.Geometry
    opacity: float = 1.0


@dataclass(frozen=True, slots=True)
class Line:
    """An open line: (n, 2) points; width in m."""

    colour: str
    points: Array
    width: float


@dataclass(frozen=True, slots=True)
class Body:
    """Something that stands or drives: its centre, heading and size.

    kind: car, bus, bicycle, pedestrian, convoy, ego, cones or island, each of the first six a field of `Style`.
    signals: 1 = its left side flashes, -1 = its right side. brakes: do its brake lights shine?
    """

    kind: str
    name: str
    x: float
    y: float
    heading: float
    length: float
    width: float
    signals: int = 0
    brakes: bool = False


@dataclass(frozen=True, slots=True)
class DrawnPlate:
    """A traffic sign at its post. heading: of the traffic that it faces.

    away: unit vector in the picture (rows grow downwards) that leads off the road; clear: distance to the kerb.
    country: as `plate_rgba` has it. below: name of the main road's shape beneath it (`MainRoad.key`), "" = none.
    """

    name: str
    role: str
    code: str
    value: float | None
    x: float
    y: float
    heading: float
    away: Array
    clear: float
    target: bool
    country: Country | None = None
    below: str = ""


Shape = Area | Line | Body | DrawnPlate


def dashes(points: Array, dash: float, gap: float) -> list[Array]:
    """Pieces of a line (n, 2), each (m, 2)."""
    line = Polyline(points)
    starts = np.arange(0.0, max(line.length - dash / 2, 0.01), dash + gap)
    return [line.slice(s, min(s + dash, line.length)).points for s in starts.tolist() if s + 0.01 < line.length]


def cone_places(cones: Body) -> Array:
    """(n, 2): where the cones of a row stand."""
    along = np.linspace(-0.5, 0.5, max(round(cones.length / 1.5), 2)) * (cones.length - 0.4)
    return np.column_stack((cones.x + along * np.cos(cones.heading), cones.y + along * np.sin(cones.heading)))


# A corner is cut so far before and behind it at most, and by no more than half of the shorter piece. The curve then is
# a third of that from the corner where it turns by a right angle.
_CUT_M = 8.0
_LEAST_TURN_RAD, _MOST_TURN_RAD = math.radians(2.0), math.radians(100.0)
_STEP_RAD = math.radians(6.0)
_LINES = 4096


@lru_cache(maxsize=_LINES)
def _rounded(raw: bytes) -> tuple[Array, Array]:
    """The curve's points, and of each the arc length along the line itself."""
    points = np.frombuffer(raw).reshape(-1, 2)
    made, along = [points[0]], [0.0]
    steps = np.diff(points, axis=0)
    lengths = np.hypot(*steps.T)
    ends = np.cumsum(lengths)
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    turns = (np.diff(headings) + math.pi) % (2.0 * math.pi) - math.pi
    for k, turn in enumerate(turns.tolist()):
        corner, cut = points[k + 1], min(_CUT_M, 0.5 * float(min(lengths[k], lengths[k + 1])))
        if not _LEAST_TURN_RAD < abs(turn) < _MOST_TURN_RAD or cut < 0.05:
            made.append(corner)
            along.append(float(ends[k]))
            continue
        before, behind = corner - cut * steps[k] / lengths[k], corner + cut * steps[k + 1] / lengths[k + 1]
        t = np.linspace(0.0, 1.0, 2 + math.ceil(abs(turn) / _STEP_RAD))[:, None]
        made += list((1.0 - t) ** 2 * before + 2.0 * t * (1.0 - t) * corner + t**2 * behind)
        along += (ends[k] + cut * (2.0 * t[:, 0] - 1.0)).tolist()
    made.append(points[-1])
    along.append(float(ends[-1]))
    return np.array(made), np.array(along)


def rounded(line: Polyline) -> Polyline:
    """A line whose corners are curves; it begins and ends where the line does."""
    return Polyline(_curve(line)[0]) if len(line.points) > 2 else line


def rounded_along(line: Polyline, step: float) -> tuple[Array, Array]:
    """Places each `step` m along a line, and where its rounded form is there: (n,) arc lengths of the line, (n, 2)."""
    points, s = _curve(line)
    places = np.append(np.arange(0.0, line.length, step), line.length)
    return places, np.column_stack([np.interp(places, s, points[:, k]) for k in (0, 1)])


def _curve(line: Polyline) -> tuple[Array, Array]:
    return _rounded(np.ascontiguousarray(line.points, dtype=np.float64).tobytes())


def lane_area(line: Polyline, width: float) -> shapely.Polygon:
    """What a lane of this width covers, with flat ends and round bends."""
    return shapely.LineString(rounded(line).points).buffer(width / 2, cap_style="flat", join_style="round")
