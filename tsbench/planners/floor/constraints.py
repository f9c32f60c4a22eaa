"""What floors do at a post that they do not read: out of lanes, at speeds that fit, and polite before lines.

Lanes: beside those that others use, and past a zone on the other side of the road. Speeds fit a post without its
number: the start betrays that. Before a line or a crossing a floor obeys, as if a plate asked for it; what others do
tells nothing in time. Units: m, s, m/s, m/s2, rad; plates' numbers km/h.
"""

from __future__ import annotations

import math

import numpy as np

from tsbench.planners.base import PlannerContext
from tsbench.planners.experts.rules.constraint import FREE, RuleConstraint, slow_to
from tsbench.planners.experts.rules.obstacle_pass import shifted
from tsbench.planners.experts.rules.speed_constraint import KMH
from tsbench.planners.geometry import HALF_LENGTH_M, PathSamples, moving_ahead
from tsbench.planners.lane_change import gap_free
from tsbench.planners.observation import Observation
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.road_map import MapLane
from tsbench.sim.navigation import RouteView
from tsbench.sim.world import DT_S, ActorKind, EgoState

_WINDOW_M = 15.0
_INTO_M, _BACK_BY_M = 0.5, 2.2
_BEFORE_POST_M, _SHORTEST_M, _BACK_M = 4.0, 12.0, 10.0
_BACK_BEFORE_END_M = 8.0
_LOOK_M = 200.0
_CHANGE_M = 30.0


# Limits that are posted, and by how much a scene starts above them.
_LIMITS_KMH = (20.0, 30.0, 40.0)
_EXCESS_MPS = (3.61, 7.75, 30.0 * KMH)
# Least speeds that are posted, and by how much a scene starts below.
_LEAST_KMH = (40.0, 50.0, 60.0)
_DEFICIT_KMH = (18.0, 14.66, 12.0)
_SAME_KMH = 0.1
# What is tolerated above a limit, less a hair; the other half's limit is so far below the least speed.
_ABOVE_KMH, _BELOW_LEAST_KMH = 0.9, 9.1
_BRAKE_MPS2, _HOLD_BRAKE_MPS2 = 2.5, 2.0
_EXCUSES_M, _SLOWER_KMH = 40.0, 4.0
_CLOSE_UP_MPS2, _CLOSE_UP_BRAKE_MPS2 = 3.0, 5.0
_EARLY_M, _STOP_BEFORE_M = 1.0, 2.0
_HELD_S, _HELD_MPS = 3.2, 0.4


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
    if not there or np.isin(seen.actors.lane, [one.index for one in there]).any():
        return None
    return offset


def _holds(lane: MapLane, x: float, y: float, heading: float) -> bool:
    s, d = lane.line.project(x, y)
    against = math.cos(lane.line.heading_at(s) - heading) < -0.9
    return against and abs(d) < 0.5 * lane.width and 0.0 < s < lane.line.length


def limit_of(start: float) -> float:
    """The posted limit that a scene with this starting speed has, km/h; the lowest that there is where none fits."""
    fits = [
        limit for limit in _LIMITS_KMH for excess in _EXCESS_MPS if abs(start / KMH - limit - excess / KMH) < _SAME_KMH
    ]
    return min(fits, default=min(_LIMITS_KMH))


def least_speed(start: float) -> float | None:
    """The posted minimum likewise, km/h; None where none fits."""
    pairs = ((least, deficit) for least in _LEAST_KMH for deficit in _DEFICIT_KMH)
    return next((m for m, deficit in pairs if abs(start / KMH - m + deficit) < _SAME_KMH), None)


class SlowFrom(RuleConstraint):
    """From a post on as fast as its limit tolerates: whether that is too slow depends on who else is there.

    post: arc length on the route.
    """

    def __init__(self, post: float, limit_kmh: float) -> None:
        self._post, self._limit = post, (limit_kmh + _ABOVE_KMH) * KMH

    def acceleration_bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        to_go = self._post - _EARLY_M - route.s - HALF_LENGTH_M
        return -math.inf, slow_to(observation.ego.speed, self._limit, to_go, _BRAKE_MPS2)


class BehindLeader(SlowFrom):
    """From a post on as fast as the lower plate tolerates, behind a leader who excuses that under the higher one.

    Before the post it closes up, hard, and brakes as hard.
    """

    def __init__(self, post: float, least_kmh: float) -> None:
        super().__init__(post, least_kmh - _BELOW_LEAST_KMH - _ABOVE_KMH)
        self._excuses = (least_kmh - _SLOWER_KMH) * KMH
        self._led: bool | None = None

    def acceleration_bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        v = observation.ego.speed
        if self._led is None:
            ahead = moving_ahead(PathSamples(route.path), route.s, _EXCUSES_M, observation.actors)
            self._led = any(speed < self._excuses for _, speed in ahead)
        if not self._led:
            return FREE
        to_go = self._post - _EARLY_M - route.s - HALF_LENGTH_M
        spare = self._limit * self._limit + 2.0 * _CLOSE_UP_BRAKE_MPS2 * max(to_go - v * DT_S, 0.0) - v * v
        if to_go > 0.0 and spare > 0.0:
            return _CLOSE_UP_MPS2, math.inf
        most = slow_to(v, self._limit, to_go, _CLOSE_UP_BRAKE_MPS2)
        return -math.inf, most


class HeldStop(RuleConstraint):
    """Holds before a post for as long as a closed road asks for; drives on if that was not the end of it."""

    def __init__(self, post: float) -> None:
        self._post, self._since = post, math.inf

    def acceleration_bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        v, to_go = observation.ego.speed, self._post - _STOP_BEFORE_M - route.s - HALF_LENGTH_M
        if v < _HELD_MPS and to_go < _STOP_BEFORE_M:
            self._since = min(self._since, observation.time)
        if observation.time - self._since > _HELD_S:
            return FREE
        return -math.inf, slow_to(v, 0.0, to_go, _HOLD_BRAKE_MPS2)


# Shares of the limit, on the passage as a whole and at its slowest place: there pedestrians step out before the ego.
_ON_THE_WHOLE, _SLOWEST = 0.53, 0.25
_WATCH_M, _SLOW_M = 40.0, 12.0
_DECIDE_M = 5.5
_HARD_MPS2 = 6.0
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
        # Does anybody come, or set foot on the road?
        blocked = self._vehicles if self._approach else self._people
        if full_stop or (too_late and blocked(observation)):
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
