"""Speed limits in a zone. Source: docs/rules.md, "Speed". Speeds in km/h here, as on the plates."""

from __future__ import annotations

import math

from tsbench.rules.monitor import Monitor, Zone
from tsbench.signs.annotations import SignInstance, overruled
from tsbench.signs.catalog import RuleSpec
from tsbench.sim.scene import Scene
from tsbench.sim.world import WorldSnapshot

KMH_PER_MPS = 3.6


class Speed(Monitor):
    """Not faster than posted, plus the tolerance, while the ego's front is in the zone.

    A plate that a temporary one overrules is passed and never broken.
    """

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene) -> None:
        super().__init__(sign, rule, scene)
        self._zone = Zone(self)
        alike = (one for one in scene.signs if scene.rule(one).name == rule.name)
        self._threshold = math.inf if overruled(sign, alike) else sign.posted + rule.thresholds["tolerance_kmh"]
        self._over = self.excursion("over_limit")

    def step(self, snapshot: WorldSnapshot) -> None:
        speed = snapshot.ego.speed * KMH_PER_MPS
        over = speed > self._threshold
        if self.engaged and not over:
            self._over.close()
            return
        inside = self._zone.front(snapshot.ego) is not None
        self.engaged = self.engaged or inside
        if inside and over:
            self._over.broken(snapshot, speed, self._threshold)
        elif not self._on_a_path(snapshot.ego.lane):
            self._over.close()

    def _on_a_path(self, lane: int) -> bool:
        """Inside a junction: paths cross there, and the ego may be on one of another road for a moment."""
        return lane >= 0 and self.scene.network.lanes[lane].internal
