"""Against the direction of a lane, in every scene. Source: docs/rules.md, "Wrong way". Units: m."""

from __future__ import annotations

import math

from tsbench.rules.monitor import InAll, Monitor
from tsbench.signs.annotations import SignInstance
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S, EgoState, WorldSnapshot


class WrongWay(Monitor):
    """Was the ego against the direction of ordinary lanes for farther than a moment in all, with no obstacle near?

    sign: the scene's target, under which events are entered; it does not matter what it asks.
    """

    def __init__(self, sign: SignInstance, scene: Scene) -> None:
        super().__init__(sign, scene.catalog.wrong_way, scene)
        self._lanes, self._obstacles = scene.network.lanes, [(o.x, o.y) for o in scene.obstacles]
        self._near = self.rule.thresholds["near_obstacle_m"]
        self._against = InAll(self.excursion("wrong_way"), self.rule.thresholds["longest_m"])

    def step(self, snapshot: WorldSnapshot) -> None:
        """One tick. What is between two stretches does not begin the count anew."""
        ego = snapshot.ego
        if self._is_against(ego):
            self._against.add(snapshot, ego.speed * DT_S)
        else:
            self._against.keep()

    def _is_against(self, ego: EgoState) -> bool:
        """At a tick. Paths inside a junction cross, and have no direction for an ego on another one."""
        lane = self._lanes[ego.lane] if ego.lane >= 0 else None
        if lane is None or lane.internal or math.cos(ego.heading - lane.line.heading_at(ego.s)) >= 0.0:
            return False
        return all(math.hypot(x - ego.x, y - ego.y) > self._near for x, y in self._obstacles)
