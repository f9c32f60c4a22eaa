"""Greatest speeds: slow from where the front crosses the plate's line (3.24, 5.21, 5.31).

Units: m, m/s; the plate's own number is km/h.
"""

from __future__ import annotations

import math

from tsbench.planners.base import PlannerContext, Privilege
from tsbench.planners.experts.rules.constraint import FREE, RuleConstraint, slow_to
from tsbench.planners.geometry import HALF_LENGTH_M
from tsbench.planners.observation import Observation
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.road_map import RoadMap
from tsbench.signs.annotations import SignInstance, overruled
from tsbench.sim.navigation import RouteView

KMH = 1.0 / 3.6
_MARGIN_KMH = 0.5
_BRAKE_MPS2 = 2.5
_EARLY_M = 1.0


class SpeedConstraint(RuleConstraint):
    """Brakes before the zone, holds the limit inside it."""

    def __init__(self, context: PlannerContext, privilege: Privilege, sign: SignInstance) -> None:
        self._roads = context.network
        self._plate = privilege.view.on_edge(sign.edge, sign.position_m)
        self._limit = (sign.posted - _MARGIN_KMH) * KMH
        self._ended_by = privilege.rule(sign).ended_by
        # Another limit ends this one where it begins, unless this one overrules it.
        others = [s for s in privilege.signs if s != sign and privilege.rule(s).name == "speed"]
        ending = (s for s in others if not overruled(s, [sign]))
        self._others = [privilege.view.on_edge(s.edge, s.position_m) for s in ending]
        self._path: RoutePath | None = None
        self._line_s = math.inf
        self._inside, self._over = False, overruled(sign, others)
        # End plates before the zone end another one.
        self._earlier: frozenset[tuple[str, float]] = frozenset()

    def acceleration_bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        """Before the zone what it takes to be slow in time, inside it the limit, behind it nothing."""
        if self._over:
            return FREE
        if not route.path.pieces:
            # A way around an obstacle is on no lanes; the navigation's runs beside it.
            route = observation.route
        if route.path is not self._path:
            self._path = route.path
            self._line_s = line_place(self._roads, route.path, *self._plate)
        front, v = route.s + HALF_LENGTH_M, observation.ego.speed
        if not self._inside and front < self._line_s:
            return -math.inf, slow_to(v, self._limit, self._line_s - _EARLY_M - front, _BRAKE_MPS2)
        # Where end plates of the kind and other limits stand that the front has passed.
        ends = [(s.edge, s.position_m) for s in observation.signs if s.code in self._ended_by]
        places, path = (*ends, *self._others), observation.route.path
        passed = frozenset(one for one in places if line_place(self._roads, path, *one) + _EARLY_M < front)
        if not self._inside:
            self._inside, self._earlier = True, passed
        self._over = bool(passed - self._earlier)
        return -math.inf, slow_to(v, self._limit, 0.0, _BRAKE_MPS2)


def line_place(roads: RoadMap, path: RoutePath, edge: str, position: float) -> float:
    """Arc length on the path of a line across an edge; inf where the path does not lead over the edge."""
    for lane in (roads.lanes[p.lane] for p in path.pieces):
        if lane.edge == edge:
            return path.line.project(*lane.line.point_at(position))[0]
    return math.inf
