"""Passing an obstacle on a side that will do: over to the lane beside as soon as it has a gap.

Units: m, s, m/s.
"""

from __future__ import annotations

import math
from collections.abc import Container
from dataclasses import dataclass, replace

import numpy as np

from tsbench.geometry.polyline import Polyline
from tsbench.planners.base import PlannerContext
from tsbench.planners.experts.rules.constraint import FREE, RuleConstraint, slow_to
from tsbench.planners.geometry import HALF_LENGTH_M
from tsbench.planners.lane_change import gap_free
from tsbench.planners.observation import Observation
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.road_map import MapLane
from tsbench.sim.navigation import RouteView
from tsbench.sim.scene import Obstacle

# A lane change takes this long where there is room; in less room it is driven slowly.
_CHANGE_S = 3.0
_SHORTEST_CHANGE_M = 9.0
_CLEAR_BEFORE_M = 1.0
_CLEAR_BEHIND_M = 2.0
_WAIT_BEFORE_M = 11.0
_BRAKE_MPS2 = 2.2
_WINDOW_M = 15.0
_SAME_M = 0.4


@dataclass(frozen=True, slots=True)
class _Task:
    """The obstacle on a route: arc lengths of its ends, and the allowed lanes beside with their offsets."""

    near: float
    far: float
    sides: tuple[tuple[MapLane, float], ...]


class ObstaclePass(RuleConstraint):
    """On the navigation's route until there is a gap, then on its own path, until the two agree again.

    obstacle: its id. allowed: sides to pass it on, of "right" and "left".
    """

    def __init__(self, context: PlannerContext, obstacle: str, allowed: Container[str]) -> None:
        self._context, self._name, self._allowed = context, obstacle, allowed
        self._path: RoutePath | None = None
        self._task: _Task | None = None
        self._own: RoutePath | None = None
        self._s = 0.0
        self._passed = self._done = False

    def route(self, observation: Observation) -> RouteView:
        route = observation.route
        if self._done:
            return route
        if self._own is None:
            self._look(observation)
            if self._task is None or not self._change(observation, self._task):
                return route
        view = self._view(observation)
        task = self._task
        if not self._passed and task is not None and view.s - HALF_LENGTH_M > task.far + _CLEAR_BEHIND_M:
            self._passed = True
            if abs(route.d) > _SAME_M:
                self._own = self._way_on(observation) or self._own
                view = self._view(observation)
        if self._passed and abs(route.d) <= _SAME_M:
            self._done = True
            return route
        return view

    def acceleration_bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        """While no lane beside is free: what stops far enough from the obstacle to swing out later."""
        task = self._task
        if self._own is not None or task is None or self._done:
            return FREE
        to_go = task.near - _WAIT_BEFORE_M - (route.s + HALF_LENGTH_M)
        return -math.inf, slow_to(observation.ego.speed, 0.0, to_go, _BRAKE_MPS2)

    def _look(self, observation: Observation) -> None:
        """Find the obstacle on the navigation's route, once a route; no task where that keeps clear of it."""
        obstacle = next((o for o in observation.obstacles if o.id == self._name), None)
        path = observation.route.path
        if obstacle is None or (path is self._path and self._task is not None):
            return
        self._path, self._task = path, self._plan(path, obstacle)

    def _plan(self, path: RoutePath, obstacle: Obstacle) -> _Task | None:
        network = self._context.network
        lane = network.lane(obstacle.lane)
        at, beside = path.line.project(obstacle.x, obstacle.y)
        sides = []
        both = (("right", lane.right), ("left", lane.left))
        # The kerb's side first: it is taken of two as near.
        for side, index in both[::-1] if network.left_hand else both:
            if side not in self._allowed or index < 0:
                continue
            beyond = network.lanes[index]
            middle = beyond.line.point_at(beyond.line.project(obstacle.x, obstacle.y)[0])
            sides.append((beyond, path.line.project(*middle)[1]))
        if not sides or min(abs(d) for _, d in sides) < _SAME_M:
            return None
        half = 0.5 * max(obstacle.length, obstacle.width)
        return _Task(at - half, at + half, tuple(sorted(sides, key=lambda side: abs(beside - side[1]))))

    def _change(self, observation: Observation, task: _Task) -> bool:
        """Set out for the first allowed lane that has a gap; False where none has one."""
        route, v = observation.route, observation.ego.speed
        room = task.near - _CLEAR_BEFORE_M - HALF_LENGTH_M - route.s
        length = min(max(_CHANGE_S * v, _SHORTEST_CHANGE_M + 3.0), max(room, _SHORTEST_CHANGE_M))
        for lane, offset in task.sides:
            if gap_free(observation, lane):
                self._own = shifted(route.path, route.s, length, offset)
                self._s = route.s
                return True
        return False

    def _view(self, observation: Observation) -> RouteView:
        path, ego = self._own, observation.ego
        assert path is not None
        self._s, d = path.line.project(ego.x, ego.y, self._s - _WINDOW_M, self._s + _WINDOW_M)
        return RouteView(path, self._s, d, max(path.destination_s - self._s, 0.0))

    def _way_on(self, observation: Observation) -> RoutePath | None:
        """The way to the destination from the lane that the ego is on behind the obstacle."""
        graph, ego, destination = self._context.graph, observation.ego, self._context.destination
        if ego.lane < 0 or graph.network.lanes[ego.lane].internal:
            return None
        edges = graph.route(graph.network.lanes[ego.lane].edge, destination.edge)
        path = None if edges is None else graph.path(edges, ego.lane, ego.s, destination)
        if path is not None:
            self._s = 0.0
        return path


def shifted(path: RoutePath, s: float, length: float, offset: float) -> RoutePath:
    """The path moved over by `offset` (left positive) within `length` m from arc length `s` on."""
    at = np.concatenate((path.line.s[path.line.s < s], np.arange(s, path.line.length, 1.0), [path.line.length]))
    share = np.clip((at - s) / length, 0.0, 1.0)
    # A sine half-wave: no jump of heading at either end.
    sideways = offset * (0.5 - 0.5 * np.cos(np.pi * share))
    points = [path.line.point_at(float(t), float(d)) for t, d in zip(at, sideways, strict=True)]
    line = Polyline(np.asarray(points))
    # No lanes: no further check of lane changes is needed.
    return replace(path, line=line, pieces=(), destination_s=path.destination_s + line.length - path.line.length)
