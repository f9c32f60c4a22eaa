"""Least speeds (4.6): fast from a while after the front has crossed the plate's line.

Units: m, m/s; the plate's own number is km/h.
"""

from __future__ import annotations

import math

from tsbench.planners.base import PlannerContext, Privilege
from tsbench.planners.experts.rules.constraint import FREE, RuleConstraint
from tsbench.planners.experts.rules.speed_constraint import KMH, line_place
from tsbench.planners.geometry import HALF_LENGTH_M, PathSamples, moving_ahead, obstacle_ahead
from tsbench.planners.observation import Observation
from tsbench.roads.lane_graph import RoutePath
from tsbench.signs.annotations import SignInstance
from tsbench.sim.navigation import RouteView

# This much above the minimum; speeding up begins where it takes this much, and never takes more.
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


class MinSpeedConstraint(RuleConstraint):
    """Speeds up in time for where the minimum binds and holds it, unless a slower vehicle is ahead."""

    def __init__(self, context: PlannerContext, privilege: Privilege, sign: SignInstance) -> None:
        self._roads = context.network
        self._plate = privilege.view.on_edge(sign.edge, sign.position_m)
        self._thresholds = privilege.rule(sign).thresholds
        self._minimum = sign.posted * KMH
        self._target = self._minimum + _ABOVE_KMH * KMH
        self._path: RoutePath | None = None
        self._samples: PathSamples
        self._binds_s = math.inf

    def acceleration_bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        """At least what reaches the minimum where it binds, and what holds it from there on."""
        if route.path is not self._path:
            self._path, self._samples = route.path, PathSamples(route.path)
            line_s = line_place(self._roads, route.path, *self._plate)
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
        """Least acceleration behind a vehicle slower than the minimum, or very close; None without one.

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
