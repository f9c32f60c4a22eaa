"""Who `ppo` and `carl` imitate at first: `idm`, which also passes an obstacle on its lane. Blind to signs.

Which side is allowed is what a plate says. The teacher takes the lane towards the kerb wherever there is one: of two
sides that are as good, a pupil without memory would learn the middle, which is the obstacle.
"""

from __future__ import annotations

import math
from dataclasses import replace

from tsbench.planners.base import Observation, PlannerContext
from tsbench.planners.experts.rules.obstacle_pass import ObstaclePass
from tsbench.planners.idm import Idm
from tsbench.roads.road_map import RoadMap

_OTHER = {"right": "left", "left": "right"}
_AHEAD_S, _LEAST_AHEAD_M = 0.9, 5.0


class Demonstrator:
    def __init__(self) -> None:
        self._idm = Idm()
        self._context: PlannerContext
        self._detour: ObstaclePass | None = None

    def reset(self, context: PlannerContext) -> None:
        self._context, self._detour = context, None
        self._idm.reset(context)

    def advise(self, observation: Observation) -> tuple[float, float]:
        """Acceleration (m/s2), and how far beside the route to aim (m, left positive); at every decision."""
        o = observation
        if self._detour is None:
            if not o.obstacles:
                return self._idm.act(o).acceleration, 0.0
            self._detour = ObstaclePass(self._context, *_one_side(o, self._context.network))
        way = self._detour.route(o)
        least, most = self._detour.acceleration_bounds(o, way)
        wished = self._idm.act(o if way is o.route else replace(o, route=way)).acceleration
        acceleration = min(max(wished, least), most)
        if way is o.route:
            return acceleration, 0.0
        point = way.path.line.point_at(way.s + max(_LEAST_AHEAD_M, _AHEAD_S * o.ego.speed))
        return acceleration, o.route.path.line.project(*point)[1]


def _one_side(o: Observation, roads: RoadMap) -> tuple[str, str]:
    """Which obstacle, here the nearest, and which side will do."""
    nearest = min(o.obstacles, key=lambda thing: (math.hypot(thing.x - o.ego.x, thing.y - o.ego.y), thing.id))
    free = roads.outer(roads.lane(nearest.lane)) >= 0
    return nearest.id, roads.kerb_side if free else _OTHER[roads.kerb_side]
