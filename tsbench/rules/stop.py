"""Stop, then give way. Source: docs/rules.md, "Stop"; numbers: `sign_catalog/rules/stop.yaml`. Units: m, m/s."""

from __future__ import annotations

import math

from tsbench.rules.give_way import GiveWay
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import RuleSpec
from tsbench.sim.scene import Scene
from tsbench.sim.world import WorldSnapshot


class Stop(GiveWay):
    """Asks a full stop of every ego that crosses the line, traffic or none; what follows is giving way."""

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene) -> None:
        super().__init__(sign, rule, scene)
        self._within = rule.thresholds["stop_within_m"]
        self._at_most = rule.thresholds["stop_speed_mps"]
        self._lowest = math.inf

    def near_line(self, snapshot: WorldSnapshot, to_go: float) -> None:
        """The lowest speed since the front came within `stop_within_m` of the line."""
        self.engaged = True
        self._lowest = min(self._lowest, snapshot.ego.speed) if to_go <= self._within else math.inf

    def at_line(self, snapshot: WorldSnapshot) -> None:
        """Clause no_full_stop. Without a tick just before the line, the speed at the line counts."""
        lowest = self._lowest if math.isfinite(self._lowest) else snapshot.ego.speed
        self._lowest = math.inf
        if lowest > self._at_most:
            self.log.event("no_full_stop", snapshot, snapshot.time, lowest, self._at_most)
            self.log.mark(snapshot.step)
