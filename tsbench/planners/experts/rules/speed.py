"""Greatest and least speeds: slow from where the front crosses the plate's line (3.24, 5.21, 5.31), fast from a while
after it (4.6). Units: m, m/s; the plate's own number is km/h.
"""

from __future__ import annotations

import math

from tsbench.planners.base import Observation, PlannerContext, Privilege
from tsbench.planners.common.speed_profile import PathSamples
from tsbench.planners.common.swept_path import HALF_LENGTH_M, moving_ahead, obstacle_ahead
from tsbench.planners.experts.rules.constraint import FREE, RuleConstraint, slow_to
from tsbench.roads.lane_graph import RoutePath
from tsbench.sim.navigation import RouteView

_KMH = 1.0 / 3.6
_MARGIN_KMH = 0.5
_BRAKE_MPS2 = 2.5
_EARLY_M = 1.0
# Least speeds: this much above the minimum; speeding up begins where it takes this much, and never takes more.
_ABOVE_KMH = 2.0
_GENTLE_MPS2 = 0.4
_BRISK_MPS2 = 3.0
_HOLD_S = 0.5
# Nearer than this to anybody, in seconds of the ego's own speed, the base planner keeps its distance as it likes.
_CLOSE_S = 1.0
# Behind who excuses it keeps to this share of the distance that does, as long as there is this room.
_KEEP_SHARE = 0.7
_KEEP_PER_S = 0.8
_KEEP_PER_S2 = 0.15
_ROOM_M = 4.0
_ROOM_S = 1.2


class SpeedConstraint(RuleConstraint):
    """Brakes before the zone, holds the limit inside it."""

    def __init__(self, context: PlannerContext, privilege: Privilege) -> None:
        self._context, self._sign = context, privilege.sign
        self._limit = (privilege.sign.posted - _MARGIN_KMH) * _KMH
        self._ended_by = privilege.rule.ended_by
        self._path: RoutePath | None = None
        self._line_s = math.inf
        self._inside = self._over = False

    def acceleration_bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        """Before the zone what it takes to be slow in time, inside it the limit, behind it nothing."""
        if self._over:
            return FREE
        if route.path is not self._path:
            self._path = route.path
            self._line_s = _place(self._context, route.path, self._sign.edge, self._sign.position_m)
        front, v = route.s + HALF_LENGTH_M, observation.ego.speed
        self._inside = self._inside or front >= self._line_s
        if not self._inside:
            return -math.inf, slow_to(v, self._limit, self._line_s - _EARLY_M - front, _BRAKE_MPS2)
        self._over = self._passed_end(observation, front)
        return -math.inf, slow_to(v, self._limit, 0.0, _BRAKE_MPS2)

    def _passed_end(self, observation: Observation, front: float) -> bool:
        ends = [s for s in observation.signs if s.code in self._ended_by]
        path = observation.route.path
        places = (_place(self._context, path, s.edge, s.position_m) for s in ends)
        return any(place + _EARLY_M < front for place in places)


class MinSpeedConstraint(RuleConstraint):
    """Speeds up in time for where the minimum binds and holds it, unless somebody slower is ahead."""

    def __init__(self, context: PlannerContext, privilege: Privilege) -> None:
        self._context, self._sign = context, privilege.sign
        self._thresholds = privilege.rule.thresholds
        self._minimum = privilege.sign.posted * _KMH
        self._target = self._minimum + _ABOVE_KMH * _KMH
        self._path: RoutePath | None = None
        self._samples: PathSamples
        self._binds_s = math.inf

    def acceleration_bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        """At least what reaches the minimum where it binds, and what holds it from there on."""
        if route.path is not self._path:
            self._path, self._samples = route.path, PathSamples(route.path)
            line_s = _place(self._context, route.path, self._sign.edge, self._sign.position_m)
            self._binds_s = line_s + self._thresholds["settle_distance_m"]
        v, left = observation.ego.speed, self._binds_s - route.s - HALF_LENGTH_M
        if math.isinf(left):
            return FREE
        behind = self._behind(observation, route.s)
        if behind is not None:
            return behind, math.inf
        if left > 0.0 and v < self._target:
            needed = (self._target * self._target - v * v) / (2.0 * left)
            return (min(needed, _BRISK_MPS2), math.inf) if needed >= _GENTLE_MPS2 else FREE
        return min((self._target - v) / _HOLD_S, _BRISK_MPS2), math.inf

    def _behind(self, observation: Observation, s: float) -> float | None:
        """Least acceleration behind somebody slower than the minimum, or very close; None where nobody is.

        Only who is within `reach` excuses: the ego does not fall back further than that, if there is room to stop.
        """
        t, v = self._thresholds, observation.ego.speed
        reach = max(t["leader_min_m"], v * v / t["leader_divisor_mps2"] + t["leader_margin_m"])
        front = s + HALF_LENGTH_M
        found = [(end - front, u) for end, u in moving_ahead(self._samples, s, reach, observation.actors)]
        found += [(obstacle_ahead(self._samples, s, o) - front, 0.0) for o in observation.obstacles]
        near = [(gap, u) for gap, u in found if gap <= (reach if u < self._minimum else _CLOSE_S * v)]
        if not near:
            return None
        gap, speed = min(near)
        if gap < _ROOM_M + _ROOM_S * v:
            return -math.inf
        return min(_KEEP_PER_S * (speed - v) + _KEEP_PER_S2 * (gap - _KEEP_SHARE * reach), _BRISK_MPS2)


def _place(context: PlannerContext, path: RoutePath, edge: str, position: float) -> float:
    """Arc length on the path of a line across an edge; inf where the path does not lead over the edge."""
    for lane in (context.network.lanes[p.lane] for p in path.pieces):
        if lane.edge == edge:
            return path.line.project(*lane.line.point_at(position))[0]
    return math.inf
