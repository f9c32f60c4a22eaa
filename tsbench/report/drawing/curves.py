"""Roads as they are built: where a lane's line has a corner, the picture has a curve. Units: m, rad."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import shapely

from tsbench.geometry.polyline import Array, Polyline

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
