"""Stopping before a closed road (3.2): past the junction, short of the plate. Units: m, m/s."""

from __future__ import annotations

import math

from tsbench.planners.base import PlannerContext, Privilege
from tsbench.planners.experts.rules.constraint import FREE, RuleConstraint, slow_to
from tsbench.planners.geometry import HALF_LENGTH_M
from tsbench.planners.observation import Observation
from tsbench.roads.lane_graph import RoutePath
from tsbench.signs.annotations import SignInstance
from tsbench.sim.navigation import RouteView

# As near to the plate as leaves the junction free behind the ego.
_STOP_BEFORE_M = 2.0
_BRAKE_MPS2 = 2.0


class ClosedRoadConstraint(RuleConstraint):
    """Follows navigation as far as the plate's line allows."""

    def __init__(self, context: PlannerContext, privilege: Privilege, sign: SignInstance) -> None:
        self._edge, s = privilege.view.on_edge(sign.edge, sign.position_m)
        self._point = context.network.edge_lanes(self._edge)[0].line.point_at(s)
        self._path: RoutePath | None = None
        self._line_s = math.inf

    def acceleration_bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        """What stops before the plate, while the route leads past it."""
        if route.path is not self._path:
            self._path = route.path
            on_way = self._edge in route.path.edges
            self._line_s = route.path.line.project(*self._point)[0] if on_way else math.inf
        if math.isinf(self._line_s):
            return FREE
        to_go = self._line_s - _STOP_BEFORE_M - (route.s + HALF_LENGTH_M)
        return -math.inf, slow_to(observation.ego.speed, 0.0, to_go, _BRAKE_MPS2)
