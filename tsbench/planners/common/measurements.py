"""The ego in a few numbers of about -1..1, for planners that learn. Blind to signs: limits are the road's own."""

from __future__ import annotations

import math

from tsbench.geometry.angles import wrap
from tsbench.planners.base import Observation
from tsbench.planners.common.route_speed import RouteSpeed
from tsbench.sim.ego import MAX_DECEL_MPS2, MAX_SPEED_MPS, MAX_STEER_RAD

_OFFSET_M, _WAY_M = 5.0, 100.0
_SOON_M = 2.0


def clip(value: float) -> float:
    return min(max(value, -1.0), 1.0)


def motion(o: Observation) -> tuple[float, float, float, float]:
    """Speed, acceleration, steering, yaw rate."""
    ego = o.ego
    return (
        ego.speed / MAX_SPEED_MPS,
        max(ego.acceleration, -MAX_DECEL_MPS2) / MAX_DECEL_MPS2,
        ego.steering / MAX_STEER_RAD,
        clip(ego.yaw_rate),
    )


def on_route(o: Observation) -> tuple[float, float]:
    """Offset from the route (over 5 m) and heading against it (rad), left positive."""
    route = o.route
    off = wrap(o.ego.heading - route.path.line.heading_at(route.s + _SOON_M))
    return clip(route.d / _OFFSET_M), clip(off)


def ahead(o: Observation, distance: float) -> tuple[float, float]:
    """The route's point so many metres on, forward and left of the ego, over that distance."""
    ego, line = o.ego, o.route.path.line
    px, py = line.point_at(min(o.route.s + distance, line.length))
    dx, dy = px - ego.x, py - ego.y
    c, s = math.cos(ego.heading), math.sin(ego.heading)
    return clip((c * dx + s * dy) / distance), clip((c * dy - s * dx) / distance)


def pace(o: Observation, speed: RouteSpeed) -> tuple[float, float, float]:
    """Speed that bends and limit allow; the limit; the way to go (over 100 m)."""
    return (
        speed.allowed(o.route, o.ego.speed) / MAX_SPEED_MPS,
        speed.limit(o.route) / MAX_SPEED_MPS,
        min(o.route.remaining / _WAY_M, 1.0),
    )
