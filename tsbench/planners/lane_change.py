"""Lane keeping by pure pursuit (Coulter 1992), and lane changes once the lane beside has a gap. Units: m, s, m/s, rad.

A route's reference line changes lanes as soon as it may, with a gap or without. A driver waits for a gap: it keeps
to its lane meanwhile, and stops where there is still room to change.
"""

from __future__ import annotations

import math

import numpy as np

from tsbench.planners.base import PlannerContext
from tsbench.planners.geometry import HALF_LENGTH_M
from tsbench.planners.observation import Observation
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.road_map import MapLane
from tsbench.sim.ego import pursue
from tsbench.sim.navigation import RouteView
from tsbench.sim.world import EgoState

# Shortest look-ahead: what still damps at walking pace; longer ones cut junction turns of 4 m radius.
LEAST_AHEAD_M = 2.0
AHEAD_S = 0.4


def follow(route: RouteView, ego: EgoState) -> float:
    """Steering angle (rad) that keeps the ego on the path of its route."""
    target = route.s + max(LEAST_AHEAD_M, AHEAD_S * ego.speed)
    tx, ty = route.path.line.point_at(target)
    return pursue(ego.x, ego.y, ego.heading, tx, ty)


def pursue_route(observation: Observation) -> float:
    """Steering angle (rad) that keeps the ego on its route: for planners that only choose a speed."""
    return follow(observation.route, observation.ego)


_LEAST_AHEAD_M = 3.0
_LEAST_BEHIND_M = 4.0
_REACTION_S = 1.0
_EASY_BRAKE_MPS2 = 2.0
_ASIDE_M = 0.3


def gap_free(observation: Observation, lane: MapLane) -> bool:
    """Could the ego be on `lane` beside where it is now without anybody having to brake hard?"""
    ego, actors, line = observation.ego, observation.actors, lane.line
    here, _ = line.project(ego.x, ego.y)
    lengths, widths = actors.length.tolist(), actors.width.tolist()
    for k, (x, y, _) in enumerate(actors.pose.tolist()):
        s, d = line.project(x, y)
        if abs(d) > 0.5 * (lane.width + widths[k]) - _ASIDE_M:
            continue
        speed = float(actors.speed[k])
        apart = abs(s - here) - HALF_LENGTH_M - 0.5 * lengths[k]
        if s >= here:
            needed = _LEAST_AHEAD_M + _to_brake(ego.speed, speed)
        else:
            needed = _LEAST_BEHIND_M + _to_brake(speed, ego.speed)
        if apart < needed:
            return False
    return True


def _to_brake(behind: float, ahead: float) -> float:
    """Way that the one behind gains on the one ahead before it is as slow: reaction, then easy braking."""
    closing = behind - ahead
    return max(closing * _REACTION_S + closing * closing / (2.0 * _EASY_BRAKE_MPS2), 0.0)


# Farther over than this, the change is under way and is finished.
_UNDER_WAY_M = 0.5
_LAST_CHANGE_M = 14.0
_SAME_M = 0.4
_WINDOW_M = 15.0


class LaneChanges:
    """Turns a route into the one to follow right now.

    Mostly it is the route itself. While a change has no gap it is the ego's own lane (`_target` >= 0: the lane
    waited for), and from there a fresh way over until it meets the route.
    """

    def __init__(self, context: PlannerContext) -> None:
        self._context = context
        self._asked: RoutePath | None = None
        self._own: RoutePath | None = None
        self._s = 0.0
        self._target = -1

    def route(self, observation: Observation, route: RouteView) -> tuple[RouteView, float]:
        """The route to follow, and the arc length on it that the front must not pass yet (inf: none)."""
        ego = observation.ego
        if route.path is not self._asked:
            self._asked, self._own, self._target = route.path, None, -1
        if self._target >= 0:
            lane = self._context.network.lanes[self._target]
            if ego.lane < 0 or abs(ego.d) > _UNDER_WAY_M or gap_free(observation, lane):
                self._target = -1
                self._own, self._s = self._way_over(ego, route.path), 0.0
        elif self._own is None or abs(route.d) < _SAME_M:
            self._own = None
        view = route if self._own is None else self._view(self._own, ego)
        if self._target < 0:
            self._target = self._blocked(observation, view)
            if self._target >= 0:
                self._own, self._s = self._keep(ego), ego.s
                view = self._view(self._own, ego)
        return view, view.path.line.length - _LAST_CHANGE_M if self._target >= 0 else math.inf

    def _blocked(self, observation: Observation, view: RouteView) -> int:
        """The next lane over, if a change to it is about to begin and there is no gap; else -1."""
        ego, roads = observation.ego, self._context.network
        lanes = roads.lanes
        wanted = view.path.lane_at(view.s) if view.path.pieces else -1
        if wanted == ego.lane or wanted < 0 or ego.lane < 0 or abs(ego.d) > _UNDER_WAY_M:
            return -1
        here, there = lanes[ego.lane], lanes[wanted]
        if here.internal or there.edge != here.edge:
            return -1
        beside = roads.inner(here) if there.order > here.order else roads.outer(here)
        return -1 if gap_free(observation, lanes[beside]) else beside

    def _keep(self, ego: EgoState) -> RoutePath:
        """The ego's own lane as a path."""
        lane = self._context.network.lanes[ego.lane]
        at, limit = np.zeros(1), np.array([lane.speed])
        return RoutePath((lane.edge,), lane.line, (), at, limit, lane.line.length)

    def _way_over(self, ego: EgoState, asked: RoutePath) -> RoutePath | None:
        """From where the ego is along the asked route's edges; None where it is on none of them."""
        edge = self._context.network.lanes[ego.lane].edge if ego.lane >= 0 else ""
        if edge not in asked.edges:
            return None
        edges = asked.edges[asked.edges.index(edge) :]
        return self._context.graph.path(edges, ego.lane, ego.s, self._context.destination)

    def _view(self, path: RoutePath, ego: EgoState) -> RouteView:
        self._s, d = path.line.project(ego.x, ego.y, self._s - _WINDOW_M, self._s + _WINDOW_M)
        return RouteView(path, self._s, d, max(path.destination_s - self._s, 0.0))
