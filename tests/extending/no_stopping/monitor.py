"""No stopping (3.27) from the plate's line on. Units: s, m/s."""

from __future__ import annotations

from tsbench.rules.monitor import Monitor, Zone
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import RuleSpec
from tsbench.sim.scene import Scene
from tsbench.sim.world import WorldSnapshot


class NoStopping(Monitor):
    """A stop becomes an event once it has lasted."""

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene) -> None:
        super().__init__(sign, rule, scene)
        self._zone = Zone(self)
        self._stopped = self.excursion("stopped")
        self._ticks: list[WorldSnapshot] = []

    def step(self, snapshot: WorldSnapshot) -> None:
        t = self.rule.thresholds
        inside = self._zone.front(snapshot.ego) is not None
        self.engaged = self.engaged or inside
        if not inside or snapshot.ego.speed >= t["standing_mps"]:
            self._end()
            return
        self._ticks.append(snapshot)
        stood = snapshot.time - self._ticks[0].time
        if stood > t["standing_s"] + 1e-9:
            for tick in self._ticks if not self._stopped.open else self._ticks[-1:]:
                self._stopped.broken(tick, stood, t["standing_s"])

    def _end(self) -> None:
        self._stopped.close()
        self._ticks.clear()
