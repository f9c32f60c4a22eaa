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
def _rounded(raw: bytes) -> Array:
    points = np.frombuffer(raw).reshape(-1, 2)
    made = [points[0]]
    steps = np.diff(points, axis=0)
    lengths = np.hypot(*steps.T)
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    turns = (np.diff(headings) + math.pi) % (2.0 * math.pi) - math.pi
    for k, turn in enumerate(turns.tolist()):
        corner, cut = points[k + 1], min(_CUT_M, 0.5 * float(min(lengths[k], lengths[k + 1])))
        if not _LEAST_TURN_RAD < abs(turn) < _MOST_TURN_RAD or cut < 0.05:
            made.append(corner)
            continue
        before, behind = corner - cut * steps[k] / lengths[k], corner + cut * steps[k + 1] / lengths[k + 1]
        t = np.linspace(0.0, 1.0, 2 + math.ceil(abs(turn) / _STEP_RAD))[:, None]
        made += list((1.0 - t) ** 2 * before + 2.0 * t * (1.0 - t) * corner + t**2 * behind)
    made.append(points[-1])
    return np.array(made)


def rounded(line: Polyline) -> Polyline:
    """A line whose corners are curves; it begins and ends where the line does."""
    points = np.ascontiguousarray(line.points, dtype=np.float64)
    return Polyline(_rounded(points.tobytes())) if len(points) > 2 else line


def lane_area(line: Polyline, width: float) -> shapely.Polygon:
    """What a lane of this width covers, with flat ends and round bends."""
    return shapely.LineString(rounded(line).points).buffer(width / 2, cap_style="flat", join_style="round")
