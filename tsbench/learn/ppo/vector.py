"""The 275 numbers that `ppo` sees: 9 ego, 10 navigation, 16 neighbours, 240 lidar. Sign-blind.

Source: docs/planners.md. Parts and sizes are MetaDrive's (Li et al., arXiv 2109.12674), what is in them is not:
that is `tsbench.bridges.metadrive.MetaDriveEyes`. All are about -1..1, float32:

* ego: speed, acceleration, steering, yaw rate, offset from the route, heading against it, room to the left and to the
  right, speed that bends and the road's own limits allow
* navigation: four points of the route (forward, left) each over its distance ahead; way to go (over 100 m); limit
* neighbours: the four that come closest, the first obstacle among them: place (forward, left, over 50 m), speed
  against the ego (over 20 m/s)
* lidar: 240 distances over 50 m from the ego's centre, ray 0 ahead, counter-clockwise
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from tsbench.geometry.polyline import Array
from tsbench.learn.networks.measurements import Recent, RouteSpeed, ahead, clip, motion, on_route, pace
from tsbench.learn.ppo.lidar import RAYS, REACH_M, Lidar, road_edges
from tsbench.planners.base import Observation, PlannerContext
from tsbench.roads.road_map import RoadMap

Vector = npt.NDArray[np.float32]

EGO, NAVIGATION, NEIGHBOURS = 9, 10, 16
SIZE = EGO + NAVIGATION + NEIGHBOURS + RAYS

_AHEAD_M = (6.0, 14.0, 26.0, 42.0)
_NEIGHBOURS = NEIGHBOURS // 4
_NOBODY = (1.0, 0.0, 0.0, 0.0)
_ROOM_M, _PASSING_MPS = 10.0, 20.0
_FORESIGHT_S = 4.0
_PER_SECOND_M = 2.0


class VectorEncoder:
    """Makes the vectors of one episode after the other; keeps the outlines of the last few networks."""

    def __init__(self) -> None:
        self._outline: Recent[RoadMap, Array] = Recent(road_edges)
        self._lidar: Lidar
        self._speed: RouteSpeed

    def reset(self, context: PlannerContext) -> None:
        self._lidar = Lidar(self._outline(context.network))
        self._speed = RouteSpeed()

    def encode(self, observation: Observation) -> Vector:
        """(275,) float32."""
        seen = self._lidar.scan(observation)
        allowed, limit, way = pace(observation, self._speed)
        left, right = float(seen[RAYS // 4]), float(seen[3 * RAYS // 4])
        room = min(left / _ROOM_M, 1.0), min(right / _ROOM_M, 1.0)
        beyond = (value for distance in _AHEAD_M for value in ahead(observation, distance))
        numbers = [*motion(observation), *on_route(observation), *room, allowed, *beyond, way, limit]
        numbers += _neighbours(observation)
        out = np.empty(SIZE, dtype=np.float32)
        out[:-RAYS] = numbers
        np.divide(seen, REACH_M, out=out[-RAYS:], casting="same_kind")
        return out


def _neighbours(o: Observation) -> list[float]:
    """Those first whose nearest distance within four seconds, both going straight on, is small and soon.

    Of obstacles the first alone, which a row of cones and the lidar's gaps make worth a place.
    """
    ego = o.ego
    c, s = math.cos(ego.heading), math.sin(ego.heading)

    def seen(x: float, y: float, vx: float, vy: float) -> tuple[float, float, float, float, float]:
        dx, dy, ux, uy = x - ego.x, y - ego.y, vx - ego.speed * c, vy - ego.speed * s
        fast = ux * ux + uy * uy
        soon = min(max(-(dx * ux + dy * uy) / fast, 0.0), _FORESIGHT_S) if fast > 1e-6 else 0.0
        rank = math.hypot(dx + ux * soon, dy + uy * soon) + _PER_SECOND_M * soon
        return rank, c * dx + s * dy, c * dy - s * dx, c * ux + s * uy, c * uy - s * ux

    bodies = [
        seen(x, y, speed * math.cos(heading), speed * math.sin(heading))
        for (x, y, heading, _, _), speed in zip(o.actors.boxes, o.actors.speed.tolist(), strict=True)
        if (x - ego.x) ** 2 + (y - ego.y) ** 2 <= REACH_M * REACH_M
    ]
    first = sorted(seen(thing.x, thing.y, 0.0, 0.0) for thing in o.obstacles)[:1]
    bodies += [body for body in first if math.hypot(body[1], body[2]) <= REACH_M]
    bodies.sort()
    out: list[float] = []
    for _, dx, dy, ux, uy in bodies[:_NEIGHBOURS]:
        out += [dx / REACH_M, dy / REACH_M, clip(ux / _PASSING_MPS), clip(uy / _PASSING_MPS)]
    return out + list(_NOBODY) * (_NEIGHBOURS - min(len(bodies), _NEIGHBOURS))
