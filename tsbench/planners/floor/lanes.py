"""Keeping out of lanes: beside those that others use, and past a zone on the other side of the road. Units: m, rad."""

from __future__ import annotations

import math

import numpy as np

from tsbench.planners.base import Observation, PlannerContext
from tsbench.planners.experts.rules.constraint import RuleConstraint
from tsbench.planners.experts.rules.obstacle_pass import shifted
from tsbench.planners.lane_change import gap_free
from tsbench.planners.swept_path import HALF_LENGTH_M
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.road_map import MapLane
from tsbench.sim.navigation import RouteView
from tsbench.sim.world import EgoState

_WINDOW_M = 15.0
_INTO_M, _BACK_BY_M = 0.5, 2.2
_BEFORE_POST_M, _SHORTEST_M, _BACK_M = 4.0, 12.0, 10.0
_BACK_BEFORE_END_M = 8.0
_LOOK_M = 200.0
_CHANGE_M = 30.0


class OwnPath(RuleConstraint):
    """Follows a path of its own."""

    def __init__(self, path: RoutePath | None = None) -> None:
        self._own, self._s = path, 0.0

    def route(self, observation: Observation) -> RouteView:
        return observation.route if self._own is None else self._view(self._own, observation.ego)

    def _view(self, path: RoutePath, ego: EgoState) -> RouteView:
        near = (self._s - _WINDOW_M, self._s + _WINDOW_M) if self._s else (-math.inf, math.inf)
        self._s, d = path.line.project(ego.x, ego.y, *near)
        return RouteView(path, self._s, d, max(path.destination_s - self._s, 0.0))


class BesideUsers(OwnPath):
    """Over to the lane away from the kerb as soon as it has a gap, and on there."""

    def __init__(self, context: PlannerContext) -> None:
        super().__init__()
        self._roads = context.network

    def route(self, observation: Observation) -> RouteView:
        ego, route = observation.ego, observation.route
        roads, lanes = self._roads, self._roads.lanes
        if self._own is None and ego.lane >= 0 and roads.inner(lanes[ego.lane]) >= 0:
            beside = lanes[roads.inner(lanes[ego.lane])]
            if gap_free(observation, beside):
                offset = -0.5 * roads.to_kerb * (lanes[ego.lane].width + beside.width)
                self._own = shifted(route.path, route.s, _CHANGE_M, offset)
        return super().route(observation)


def oncoming_path(context: PlannerContext, seen: Observation, post: float) -> RoutePath | None:
    """The route with its centre just across the middle of the road, from a post (arc length) to the destination.

    None without an oncoming side, or with a vehicle on it.
    """
    route, offset = seen.route, _to_oncoming(context, seen, post)
    if offset is None:
        return None
    over = shifted(route.path, route.s, max(post - HALF_LENGTH_M - _BEFORE_POST_M - route.s, _SHORTEST_M), offset)
    back = over.destination_s - _BACK_BEFORE_END_M
    return shifted(over, back, _BACK_M, -math.copysign(min(_BACK_BY_M, abs(offset)), offset))


def _to_oncoming(context: PlannerContext, seen: Observation, post: float) -> float | None:
    roads, route = context.network, seen.route
    lanes = roads.lanes
    lane = lanes[route.path.lane_at(post)] if route.path.pieces else None
    if lane is None:
        return None
    offset = 0.5 * lane.width
    while roads.inner(lane) >= 0:
        lane = lanes[roads.inner(lane)]
        offset += lane.width
    offset = -roads.to_kerb * (offset + _INTO_M)
    x, y = route.path.line.point_at(post, offset)
    heading = route.path.line.heading_at(post)
    there = [one for one in lanes if not one.internal and _holds(one, x, y, heading)]
    if not there or _somebody_comes(seen, there):
        return None
    return offset


def _holds(lane: MapLane, x: float, y: float, heading: float) -> bool:
    s, d = lane.line.project(x, y)
    against = math.cos(lane.line.heading_at(s) - heading) < -0.9
    return against and abs(d) < 0.5 * lane.width and 0.0 < s < lane.line.length


def _somebody_comes(seen: Observation, lanes: list[MapLane]) -> bool:
    on_it = np.isin(seen.actors.lane, [lane.index for lane in lanes])
    return bool(on_it.any())
