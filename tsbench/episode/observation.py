"""What a planner is shown at each tick. Ranges are part of the benchmark: the same in training and in use."""

from __future__ import annotations

import math

import numpy as np

from tsbench.core.benchmark import OBSTACLE_RANGE_M, SIGN_RANGE_M
from tsbench.planners.base import Observation, SignView
from tsbench.sim.navigation import RouteView
from tsbench.sim.scene import Scene
from tsbench.sim.world import WorldSnapshot

HISTORY_TICKS = 20


class Observer:
    """Builds observations for one episode; keeps the ego's history."""

    def __init__(self, scene: Scene, mask_signs: bool) -> None:
        # With masked signs a plate keeps its place and the way it faces, not its identity.
        self._signs = [
            (s, "" if mask_signs else s.code, None if mask_signs else s.value) for s in scene.signs
        ]
        self._obstacles = scene.obstacles
        self._history = np.empty((scene.horizon + 2, 4))

    def observe(self, snapshot: WorldSnapshot, route: RouteView) -> Observation:
        """The observation at this tick; call once per tick, in order."""
        ego, k = snapshot.ego, snapshot.step
        self._history[k] = (ego.x, ego.y, ego.heading, ego.speed)
        history = self._history[max(k + 1 - HISTORY_TICKS, 0) : k + 1]
        history.setflags(write=False)
        signs = []
        for s, code, value in self._signs:
            distance = math.hypot(s.x - ego.x, s.y - ego.y)
            if distance <= SIGN_RANGE_M:
                view = SignView(code, value, s.x, s.y, s.heading, s.edge, s.lane, s.position_m, distance)
                signs.append(view)
        if len(signs) > 1:
            signs.sort(key=_by_distance)
        obstacles = self._obstacles and tuple(
            o for o in self._obstacles if math.hypot(o.x - ego.x, o.y - ego.y) <= OBSTACLE_RANGE_M
        )
        return Observation(k, snapshot.time, ego, history, route, snapshot.actors, tuple(signs), obstacles)


def _by_distance(sign: SignView) -> float:
    return sign.distance
