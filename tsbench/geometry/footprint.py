"""Oriented rectangles: footprints of vehicles, pedestrians and obstacles. Units: m, rad."""

from __future__ import annotations

import math

Corners = tuple[tuple[float, float], tuple[float, float], tuple[float, float], tuple[float, float]]
# Least and greatest x, least and greatest y.
Band = tuple[float, float, float, float]


def corners(x: float, y: float, heading: float, length: float, width: float) -> Corners:
    """Corners of a rectangle by its centre: front-left, rear-left, rear-right, front-right."""
    c, s = math.cos(heading), math.sin(heading)
    fx, fy, lx, ly = c * length / 2, s * length / 2, -s * width / 2, c * width / 2
    return (
        (x + fx + lx, y + fy + ly),
        (x - fx + lx, y - fy + ly),
        (x - fx - lx, y - fy - ly),
        (x + fx - lx, y + fy - ly),
    )


def front(x: float, y: float, heading: float, length: float) -> tuple[float, float]:
    return x + math.cos(heading) * length / 2, y + math.sin(heading) * length / 2


def boxes_overlap(
    ax: float, ay: float, ah: float, al: float, aw: float, bx: float, by: float, bh: float, bl: float, bw: float
) -> bool:
    """Do two rectangles (centre, heading, length, width) overlap? Separating-axis test, closed sets."""
    dx, dy = bx - ax, by - ay
    reach = math.hypot(al, aw) + math.hypot(bl, bw)
    if 4.0 * (dx * dx + dy * dy) > reach * reach:
        return False
    ca, sa, cb, sb = math.cos(ah), math.sin(ah), math.cos(bh), math.sin(bh)
    c, s = abs(ca * cb + sa * sb), abs(ca * sb - sa * cb)
    return (
        2.0 * abs(dx * ca + dy * sa) <= al + bl * c + bw * s
        and 2.0 * abs(dy * ca - dx * sa) <= aw + bl * s + bw * c
        and 2.0 * abs(dx * cb + dy * sb) <= bl + al * c + aw * s
        and 2.0 * abs(dy * cb - dx * sb) <= bw + al * s + aw * c
    )


def share_in_band(x: float, y: float, heading: float, length: float, width: float, band: Band) -> float:
    """The share of a rectangle that lies in a band: 0 to 1.

    x, y, heading: in the band's frame (x along it, y across).
    """
    points: list[tuple[float, float]] = list(corners(x, y, heading, length, width))
    for axis, sign, limit in ((0, -1.0, -band[0]), (0, 1.0, band[1]), (1, -1.0, -band[2]), (1, 1.0, band[3])):
        points = _cut(points, axis, sign, limit)
    twice = sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(points, points[1:] + points[:1], strict=True))
    return abs(twice) / 2 / (length * width)


def _cut(points: list[tuple[float, float]], axis: int, sign: float, limit: float) -> list[tuple[float, float]]:
    """What is left of a polygon where sign * coordinate <= limit."""
    left: list[tuple[float, float]] = []
    for a, b in zip(points, points[1:] + points[:1], strict=True):
        over_a, over_b = sign * a[axis] - limit, sign * b[axis] - limit
        if over_a <= 0.0:
            left.append(a)
        if (over_a < 0.0) != (over_b < 0.0) and over_a != 0.0 and over_b != 0.0:
            t = over_a / (over_a - over_b)
            left.append((a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])))
    return left
