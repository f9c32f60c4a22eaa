"""No stopping (3.27): goes on inside the zone, unless somebody is in the way. Units: m, m/s, m/s2."""

from __future__ import annotations

import math

from tsbench.planners.base import PlannerContext, Privilege
from tsbench.planners.experts.rules.constraint import FREE, RuleConstraint
from tsbench.planners.experts.rules.speed_constraint import line_place
from tsbench.planners.geometry import HALF_LENGTH_M, PathSamples, moving_ahead
from tsbench.planners.observation import Observation
from tsbench.signs.annotations import SignInstance
from tsbench.sim.navigation import RouteView

_LEAST_MPS = 2.0
_SPEEDS_UP_MPS2 = 1.0
_ROOM_M = 15.0


class NoStoppingConstraint(RuleConstraint):
    """Keeps a base planner that would stand still at a walk."""

    def __init__(self, context: PlannerContext, privilege: Privilege, sign: SignInstance) -> None:
        self._roads = context.network
        self._plate = privilege.view.on_edge(sign.edge, sign.position_m)

    def acceleration_bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        line_s = line_place(self._roads, route.path, *self._plate)
        inside = route.s + HALF_LENGTH_M > line_s
        if not inside or observation.ego.speed >= _LEAST_MPS:
            return FREE
        if moving_ahead(PathSamples(route.path), route.s, _ROOM_M, observation.actors):
            return FREE
        return _SPEEDS_UP_MPS2, math.inf
