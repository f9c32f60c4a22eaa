"""What stands or moves in the strip of road that the ego is about to sweep. Units: m, m/s, rad.

The strip is a chain of discs, one at each metre of the path. A body is looked for by sphere tracing
(Hart 1996): where it is `d` away from the strip, the next `d` metres of the path cannot touch it. That needs
a few scalar steps a body.
"""

from __future__ import annotations

import math

from tsbench.planners.speed_profile import PathSamples
from tsbench.sim.scene import Obstacle
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M, Agents, Box

STRIP_HALF_M = EGO_WIDTH_M / 2 + 0.25
HALF_LENGTH_M = EGO_LENGTH_M / 2


def moving_ahead(samples: PathSamples, s: float, reach: float, actors: Agents) -> list[tuple[float, float]]:
    """Road users with a part in the strip from the front of an ego at `s` on, up to `reach` m.

    Each as (arc length of its nearest end, its speed along the path, not below 0).
    """
    found: list[tuple[float, float]] = []
    first = max(math.ceil(s + HALF_LENGTH_M + STRIP_HALF_M), 0)
    last = min(int(s + HALF_LENGTH_M + reach), samples.last)
    if first > last:
        return found
    x, y, sqrt = samples.x[first], samples.y[first], math.sqrt
    for row, box in enumerate(actors.boxes):
        # The first step of `first_contact`, taken here: most of them are farther away than the strip is long.
        dx, dy = x - box[0], y - box[1]
        away = sqrt(dx * dx + dy * dy) - 0.5 * (box[3] + box[4]) - STRIP_HALF_M
        start = first + int(away) if away >= 1.0 else first
        k = first_contact(samples, start, last, box) if start <= last else -1
        if k >= 0:
            along = math.cos(box[2]) * samples.cos[k] + math.sin(box[2]) * samples.sin[k]
            found.append((nearest_end(samples, k, box), max(float(actors.speed[row]) * along, 0.0)))
    return found


def obstacle_ahead(samples: PathSamples, s: float, obstacle: Obstacle) -> float:
    """Arc length of the near end of an obstacle that lies in the strip ahead of `s`, else infinity."""
    box = (obstacle.x, obstacle.y, obstacle.heading, obstacle.length, obstacle.width)
    k = first_contact(samples, max(int(s), 0), samples.last, box)
    return math.inf if k < 0 else nearest_end(samples, k, box)


def first_contact(samples: PathSamples, first: int, last: int, box: Box) -> int:
    """The first sample in [first, last] whose disc touches the box, or -1."""
    x, y, heading, length, width = box
    radius = 0.5 * (length + width) + STRIP_HALF_M
    half_l, half_w = 0.5 * length, 0.5 * width
    xs, ys = samples.x, samples.y
    c = s = 0.0
    turned = False
    k = first
    while k <= last:
        dx, dy = xs[k] - x, ys[k] - y
        d = math.sqrt(dx * dx + dy * dy) - radius
        if d < 1.0:
            if not turned:
                c, s, turned = math.cos(heading), math.sin(heading), True
            u = abs(c * dx + s * dy) - half_l
            v = abs(c * dy - s * dx) - half_w
            d = (math.sqrt(u * u + v * v) if u > 0.0 and v > 0.0 else max(u, v)) - STRIP_HALF_M
            if d <= 0.0:
                return k
        k += int(d) or 1
    return -1


def nearest_end(samples: PathSamples, k: int, box: Box) -> float:
    """Arc length of the box's nearest extent, measured along the path's direction at sample k."""
    x, y, heading, length, width = box
    c, s = samples.cos[k], samples.sin[k]
    along = (x - samples.x[k]) * c + (y - samples.y[k]) * s
    ch, sh = math.cos(heading), math.sin(heading)
    extent = 0.5 * (length * abs(ch * c + sh * s) + width * abs(sh * c - ch * s))
    # A long body that stands across reaches back beyond the strip: what counts is where it is first touched.
    return k + max(along - extent, -STRIP_HALF_M)
