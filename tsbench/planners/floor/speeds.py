"""Speeds that fit a post without its number: the start betrays that. Units: m, s, m/s; plates' numbers km/h."""

from __future__ import annotations

import math

from tsbench.planners.base import Observation
from tsbench.planners.experts.rules.constraint import FREE, RuleConstraint, slow_to
from tsbench.planners.experts.rules.speed_constraint import KMH
from tsbench.planners.speed_profile import PathSamples
from tsbench.planners.swept_path import HALF_LENGTH_M, moving_ahead
from tsbench.sim.navigation import RouteView
from tsbench.sim.world import DT_S

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
