"""Exit onto a one-way road (5.7.x): allowed turns, and never the wrong carriageway. Source: docs/rules.md.

Degrees in evidence.
"""

from __future__ import annotations

import math

from tsbench.geometry.elementary import wrap
from tsbench.rules.manoeuvre import Manoeuvre
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import RuleSpec
from tsbench.sim.scene import Scene
from tsbench.sim.world import EgoState, WorldSnapshot


class OneWayExit(Manoeuvre):
    """The rule of manoeuvre; where the ego enters an arm, its lane may not run against it."""

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene) -> None:
        super().__init__(sign, rule, scene)
        self._against = rule.thresholds["against_deg"]

    def resolved(self, snapshot: WorldSnapshot, ego: EgoState) -> None:
        """Clause wrong_carriageway, judged at each pass."""
        lane = self._network.lanes[ego.lane]
        angle = abs(math.degrees(wrap(ego.heading - lane.line.heading_at(ego.s))))
        if angle > self._against:
            self.log.event("wrong_carriageway", snapshot, snapshot.time, angle, self._against)
            self.log.mark(snapshot.step)
