"""Before a line or a crossing: it obeys, as if a plate asked for it. What others do tells nothing in time.

Units: m, s, m/s, m/s2.
"""

from __future__ import annotations

import math

import numpy as np

from tsbench.planners.base import Observation, PlannerContext
from tsbench.planners.experts.rules.constraint import FREE, RuleConstraint, slow_to
from tsbench.planners.geometry import HALF_LENGTH_M
from tsbench.roads.lane_graph import RoutePath
from tsbench.sim.navigation import RouteView
from tsbench.sim.world import ActorKind

# Shares of the limit, on the passage as a whole and at its slowest place: there pedestrians step out before the ego.
_ON_THE_WHOLE, _SLOWEST = 0.53, 0.25
_WATCH_M, _SLOW_M = 40.0, 12.0
_DECIDE_M = 5.5
_BRAKE_MPS2, _HARD_MPS2 = 2.5, 6.0
_COMES_S = 5.0
_STANDS_MPS = 0.2
_HOLD_M = 1.0
_WALKS_MPS = 0.2
_KERB_M = 3.0


class Polite(RuleConstraint):
    """Stops before a junction and waits there for other vehicles; slows before a crossing for pedestrians.

    approach: the edge at whose end the line is; "": the route's first crossing is meant, and people.
    """

    def __init__(self, context: PlannerContext, approach: str) -> None:
        self._map, self._approach = context.network, approach
        self._path: RoutePath | None = None
        self._line = math.inf
        self._stopped = False

    def acceleration_bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        if route.path is not self._path:
            self._path, self._line = route.path, self.line_on(route.path)
        to_go, v = self._line - route.s - HALF_LENGTH_M, observation.ego.speed
        if to_go < 0.0 or to_go > _WATCH_M:
            return FREE
        if v < _STANDS_MPS:
            self._stopped = True
        limit = route.path.limit_at(route.s)
        most = slow_to(v, _ON_THE_WHOLE * limit, 0.0, _BRAKE_MPS2)
        if to_go < _SLOW_M:
            most = min(most, slow_to(v, _SLOWEST * limit, to_go - _DECIDE_M, _BRAKE_MPS2))
        full_stop = bool(self._approach) and not self._stopped
        too_late = to_go < _DECIDE_M or v * v > 2.0 * _HARD_MPS2 * to_go
        if full_stop or (too_late and self._blocked(observation)):
            most = min(most, slow_to(v, 0.0, to_go - _HOLD_M, _BRAKE_MPS2 if full_stop else _HARD_MPS2))
        return -math.inf, most

    def line_on(self, path: RoutePath) -> float:
        """Metres along a path to where the road ends at the junction, or the first crossing begins; -inf: not on it."""
        if self._approach:
            ends = [p.s1 for p in path.pieces if self._map.lanes[p.lane].edge == self._approach]
            return max(ends, default=-math.inf)
        places = []
        for crossing in self._map.crossings.values():
            if set(crossing.edges) & set(path.edges):
                middle = crossing.line.point_at(0.5 * crossing.line.length)
                places.append(path.line.project(*middle)[0] - 0.5 * crossing.width)
        return min(places, default=-math.inf)

    def _blocked(self, observation: Observation) -> bool:
        """Does anybody come, or set foot on the road?"""
        return self._vehicles(observation) if self._approach else self._people(observation)

    def _vehicles(self, observation: Observation) -> bool:
        actors, lanes = observation.actors, self._map.lanes
        junction, found = self._map.edges[self._approach].target, False
        for k, index in enumerate(actors.lane.tolist()):
            speed = float(actors.speed[k])
            # Waiting for a vehicle that stands as well would never end.
            both_stand = max(speed, observation.ego.speed) < _STANDS_MPS
            if index < 0 or both_stand or lanes[index].edge == self._approach:
                continue
            lane = lanes[index]
            x, y = actors.pose[k, :2].tolist()
            if lane.internal:
                middle = self._map.junctions[junction]
                found = found or math.hypot(middle.x - x, middle.y - y) < 15.0
            elif self._map.edges[lane.edge].target == junction:
                left = lane.line.length - lane.line.project(x, y)[0] - 0.5 * float(actors.length[k])
                found = found or left / max(speed, 2.0) < _COMES_S
        return found

    def _people(self, observation: Observation) -> bool:
        actors = observation.actors
        walking = (actors.kind == ActorKind.PEDESTRIAN) & (actors.speed > _WALKS_MPS)
        for k in np.flatnonzero(walking).tolist():
            x, y, heading = actors.pose[k].tolist()
            for crossing in self._map.crossings.values():
                s, d = crossing.line.project(x, y)
                (x0, y0), (x1, y1) = crossing.line.points[[0, -1]].tolist()
                outside = math.hypot(x - crossing.line.point_at(s)[0], y - crossing.line.point_at(s)[1])
                along = abs((x1 - x0) * math.cos(heading) + (y1 - y0) * math.sin(heading)) / crossing.line.length
                if min(outside, abs(d)) < _KERB_M and along > 0.5:
                    return True
        return False
