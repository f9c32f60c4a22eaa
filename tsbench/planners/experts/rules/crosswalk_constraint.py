"""Letting people cross first (5.19): stops before the crossing until no pedestrian can be on it with the ego.

Units: m, s, m/s. u runs along the crossing's middle line from one kerb (0) to the other, w across it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tsbench.planners.base import PlannerContext, Privilege
from tsbench.planners.experts.rules.constraint import FREE, RuleConstraint, slow_to
from tsbench.planners.geometry import HALF_LENGTH_M, PathSamples, moving_ahead
from tsbench.planners.observation import Observation
from tsbench.roads.lane_graph import RoutePath
from tsbench.signs.annotations import SignInstance
from tsbench.signs.rule_kinds import CrosswalkParams
from tsbench.sim.navigation import RouteView
from tsbench.sim.world import EGO_WIDTH_M, ActorKind, Agents

_STOP_BEFORE_M = 1.0
_BRAKE_MPS2 = 2.2
# A pedestrian at the kerb may set off: braking hard for that is kept in hand.
_HARD_MPS2 = 3.5
_SETS_OFF_MPS = 1.5
_STANDS_MPS = 0.1
_WAIT_LIMIT_S = 10.0
_WAITING_MPS = 0.3
_EARLY_S, _LATE_S = 0.6, 0.3
_SPARE_M = 0.2
_BESIDE_M = 3.0
_SEEN_FROM_KERB_M = 25.0
_SLOW_MPS2, _QUICK_MPS2, _BRISK_MPS2 = 1.0, 2.0, 1.5
_BRISKLY_TO_MPS = 5.0
_ROOM_M = 3.0
_LOOK_M = 70.0


@dataclass(frozen=True, slots=True)
class _Crossing:
    """Where a route crosses: arc lengths of the crossing's edges, and the route's u."""

    near: float
    far: float
    u: float


class CrosswalkConstraint(RuleConstraint):
    """Follows navigation; asks at each tick before the crossing whether it may go on."""

    def __init__(self, context: PlannerContext, privilege: Privilege, sign: SignInstance) -> None:  # noqa: ARG002
        params = sign.params_as(CrosswalkParams)
        self._crossing = privilege.network.crossings[params.crossing]
        self._exit = privilege.view.on_edge(params.exit)[0]
        self._clear = privilege.rule(sign).thresholds["clearance_m"] + _SPARE_M
        (self._x, self._y), (x, y) = self._crossing.line.points[[0, -1]].tolist()
        self._length = math.hypot(x - self._x, y - self._y)
        self._c, self._s = (x - self._x) / self._length, (y - self._y) / self._length
        self._path: RoutePath | None = None
        self._here: _Crossing | None = None
        self._samples: PathSamples
        self._waits_since = math.inf
        self._waits_for_standing = True

    def acceleration_bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        """What stops before the crossing while a pedestrian is on it or comes; what leaves it briskly."""
        if route.path is not self._path:
            self._path, self._here = route.path, self._crossed(route.path)
            self._samples = PathSamples(route.path)
        here, v = self._here, observation.ego.speed
        if here is None or route.s - HALF_LENGTH_M > here.far:
            return FREE
        to_go = here.near - (route.s + HALF_LENGTH_M)
        if to_go > _LOOK_M:
            return FREE
        ahead = moving_ahead(self._samples, route.s, here.far - route.s + 20.0, observation.actors)
        if to_go < 0.0:
            # On it: people who come now were far enough away; off it as soon as traffic allows.
            return (_BRISK_MPS2 if not ahead and v < _BRISKLY_TO_MPS else -math.inf), math.inf
        if v > _WAITING_MPS:
            self._waits_since = math.inf
        elif math.isinf(self._waits_since):
            self._waits_since = observation.time
        stop = to_go - _STOP_BEFORE_M
        room = here.far + 2.0 * HALF_LENGTH_M + _ROOM_M
        if any(end < room and speed < 1.0 for end, speed in ahead):
            return -math.inf, slow_to(v, 0.0, stop, _BRAKE_MPS2)
        enters = _time(v, to_go, _QUICK_MPS2)
        leaves = _time(v, here.far - route.s + HALF_LENGTH_M, _SLOW_MPS2)
        most = math.inf
        self._waits_for_standing = self._waits_for_standing and observation.time - self._waits_since < _WAIT_LIMIT_S
        for begins, ends, certain in self._taken(observation.actors, here.u):
            if leaves + _EARLY_S < begins or enters > ends + _LATE_S or not (certain or self._waits_for_standing):
                continue
            most = min(most, slow_to(v, 0.0, stop, _BRAKE_MPS2 if certain else _HARD_MPS2))
        return -math.inf, most

    def _crossed(self, path: RoutePath) -> _Crossing | None:
        """Where the path meets the crossing's middle line; None where it does not lead over it."""
        if self._exit not in path.edges:
            return None
        u = 0.5 * self._length
        for _ in range(3):
            s, _ = path.line.project(self._x + u * self._c, self._y + u * self._s)
            x, y = path.line.point_at(s)
            u = (x - self._x) * self._c + (y - self._y) * self._s
        half = 0.5 * self._crossing.width
        return None if s < -half else _Crossing(s - half, s + half, u)

    def _taken(self, actors: Agents, u_ego: float) -> list[tuple[float, float, bool]]:
        """For each pedestrian that matters: from when until when it forbids to be on the crossing, in s from now.

        The third is False for a pedestrian that only stands there and may set off.
        """
        taken = []
        for at in np.flatnonzero(actors.kind == ActorKind.PEDESTRIAN).tolist():
            x, y, heading = actors.pose[at].tolist()
            speed, length = float(actors.speed[at]), float(actors.length[at])
            dx, dy = x - self._x, y - self._y
            u, w = dx * self._c + dy * self._s, dy * self._c - dx * self._s
            along = math.cos(heading) * self._c + math.sin(heading) * self._s
            outside = max(-u, u - self._length)
            if abs(w) > 0.5 * self._crossing.width + _BESIDE_M or outside > _SEEN_FROM_KERB_M:
                continue
            if outside > 0.0 and along * (1.0 if u < 0.0 else -1.0) <= 0.0:
                continue
            stands = speed <= _STANDS_MPS
            pace = _SETS_OFF_MPS if stands else speed
            # Where it stops to forbid: past the ego's strip, seen in the direction that it walks in.
            to_clear = EGO_WIDTH_M / 2 + self._clear + 0.5 * length - math.copysign(1.0, along) * (u - u_ego)
            if to_clear <= 0.0:
                continue
            ends = math.inf if stands else to_clear / pace
            taken.append((max(outside, 0.0) / pace, ends, not stands or outside <= 0.0))
        return taken


def _time(v: float, way: float, accel: float) -> float:
    """Seconds for `way` metres from speed v at a constant acceleration."""
    return (math.sqrt(v * v + 2.0 * accel * max(way, 0.0)) - v) / accel
