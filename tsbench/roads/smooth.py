"""Lines joined of pieces, without the points that only the cuts between the pieces put in. Units: m."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsbench.geometry.polyline import Array, Polyline

# netconvert rounds to centimetres: a point put in on a straight line is at most so far beside it.
_BESIDE_M = 0.015


def joined(parts: Sequence[Array]) -> Polyline:
    """The line through (k, 2) points of parts that follow each other.

    SUMO cuts the path of a turn where a car would wait, which depends on the right of way. So the points
    at cuts go first where they lie on the line without them; then whatever others do, the least first, that one drive
    gives one line however it was cut.
    """
    points = [part[0] for part in parts[:1]]
    cuts: set[int] = set()
    for number, part in enumerate(parts):
        if number and np.hypot(*(part[0] - points[-1])) > _BESIDE_M:
            points.append(part[0])
        elif number:
            cuts.add(len(points) - 1)
        points.extend(part[1:])
    line = np.array(points)
    kept = [
        k for k in range(len(line)) if k not in cuts or _beside(line, _whole(k, cuts, len(line))) > _BESIDE_M
    ]
    while len(kept) > 2:
        away = [_beside(line, kept[k - 1 : k + 2]) for k in range(1, len(kept) - 1)]
        least = int(np.argmin(away))
        if away[least] > _BESIDE_M:
            break
        del kept[least + 1]
    return Polyline(line[kept])


def _whole(k: int, cuts: set[int], count: int) -> list[int]:
    """A point with the nearest ones before and behind it that no cut put in."""
    before = next(i for i in range(k - 1, -1, -1) if i not in cuts or i == 0)
    behind = next(i for i in range(k + 1, count) if i not in cuts or i == count - 1)
    return [before, k, behind]


def _beside(line: Array, three: list[int]) -> float:
    """How far the middle one of three points is from the straight line between the others."""
    (ax, ay), (x, y), (bx, by) = line[three].tolist()
    dx, dy = bx - ax, by - ay
    length = float(np.hypot(dx, dy))
    return abs(dx * (y - ay) - dy * (x - ax)) / length if length > 0.0 else float(np.hypot(x - ax, y - ay))
