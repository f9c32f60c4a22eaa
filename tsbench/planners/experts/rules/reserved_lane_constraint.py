"""Reserved lanes (5.11, 5.14): over to the lane beside before the plate, as soon as that has a gap. Units: m, m/s."""

from __future__ import annotations

import math
from dataclasses import replace

from tsbench.planners.base import PlannerContext, Privilege
from tsbench.planners.experts.rules.constraint import FREE, RuleConstraint, slow_to
from tsbench.planners.geometry import HALF_LENGTH_M
from tsbench.planners.lane_change import gap_free
from tsbench.planners.observation import Observation
from tsbench.roads.lane_graph import MapGraph, RoutePath
from tsbench.roads.road_map import MapLane
from tsbench.signs.annotations import SignInstance
from tsbench.signs.rule_kinds import ReservedLaneParams
from tsbench.sim.navigation import RouteView
from tsbench.sim.world import EgoState

_WAIT_BEFORE_M = 14.0
_BRAKE_MPS2 = 2.2
_WINDOW_M = 15.0
_SAME_M = 0.4


class ReservedLaneConstraint(RuleConstraint):
    """On the navigation's route until there is a gap, then on its own, until navigation keeps out of the lane too."""

    def __init__(self, context: PlannerContext, privilege: Privilege, sign: SignInstance) -> None:
        self._map, self._destination = context.network, context.destination
        network, params = privilege.network, sign.params_as(ReservedLaneParams)
        lanes = [network.lane(name) for name in params.lanes]
        # The map has no cut where the lane begins, or ends, to be reserved.
        self._ends = [end for lane in lanes for end in (lane.line.points[0], lane.line.points[-1])]
        self._ends.append(network.edge_lanes(params.approach)[0].line.points[-1])
        self._reserved = frozenset(privilege.view.places[lane.index].lane for lane in lanes)
        self._graph = MapGraph(self._map, self._reserved)
        self._to_left = privilege.rule(sign).option("lane") == "rightmost"
        self._path: RoutePath | None = None
        self._near, self._far = math.inf, -math.inf
        self._own: RoutePath | None = None
        self._s = 0.0

    def route(self, observation: Observation) -> RouteView:
        route = observation.route
        if route.path is not self._path:
            self._look(route.path)
        leads_in = route.s <= self._far
        if self._own is None:
            if not leads_in or not self._change(observation):
                return route
        elif not leads_in and abs(route.d) <= _SAME_M:
            self._own = None
            return route
        return self._view(observation.ego)

    def acceleration_bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        """While the lane beside has no gap: what stops far enough before the plate to change over later."""
        front = route.s + HALF_LENGTH_M
        if self._own is not None or route.s > self._far or front > self._near:
            return FREE
        return -math.inf, slow_to(observation.ego.speed, 0.0, self._near - _WAIT_BEFORE_M - front, _BRAKE_MPS2)

    def _look(self, path: RoutePath) -> None:
        """From where to where does the navigation's route lead through a reserved lane?"""
        self._path, inside = path, any(p.lane in self._reserved for p in path.pieces)
        places = [path.line.project(x, y)[0] for x, y in self._ends] if inside else []
        self._near, self._far = min(places, default=math.inf), max(places, default=-math.inf)

    def _change(self, observation: Observation) -> bool:
        """Set out for the lane beside if it has a gap, and from there on without the reserved lane."""
        ego, edges = observation.ego, observation.route.path.edges
        beside = self._beside(ego)
        if beside is None or beside.edge not in edges or not gap_free(observation, beside):
            return False
        ahead = edges[edges.index(beside.edge) :]
        room = max(self._near - observation.route.s, 0.0)
        path = self._graph.path(ahead, ego.lane, ego.s, self._destination, room)
        if path is None:
            return False
        # No lanes: no further check of lane changes is needed.
        self._own, self._s = replace(path, pieces=()), 0.0
        return True

    def _beside(self, ego: EgoState) -> MapLane | None:
        """The lane for cars next to the ego's, away from the reserved one."""
        lane = self._map.lanes[ego.lane] if ego.lane >= 0 else None
        index = -1 if lane is None or lane.internal else lane.left if self._to_left else lane.right
        return self._map.lanes[index] if index >= 0 and index not in self._reserved else None

    def _view(self, ego: EgoState) -> RouteView:
        path = self._own
        assert path is not None
        self._s, d = path.line.project(ego.x, ego.y, self._s - _WINDOW_M, self._s + _WINDOW_M)
        return RouteView(path, self._s, d, max(path.destination_s - self._s, 0.0))
