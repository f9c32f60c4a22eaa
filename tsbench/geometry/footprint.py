"""Oriented rectangles: footprints of vehicles, pedestrians and obstacles. Units: m, rad."""

from __future__ import annotations

import math

Corners = tuple[tuple[float, float], tuple[float, float], tuple[float, float], tuple[float, float]]


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
    ax: float, ay: float, ah: float, al: float, aw: float,
    bx: float, by: float, bh: float, bl: float, bw: float,
) -> bool:  # fmt: skip
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
