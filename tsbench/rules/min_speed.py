"""Minimum speed in a zone. Source: docs/rules.md, "Speed". Speeds in km/h as on the plates."""

from __future__ import annotations

from tsbench.rules.monitor import Monitor, Verdict, Zone
from tsbench.rules.open_speed import Leaders
from tsbench.rules.speed import KMH_PER_MPS
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import RuleSpec
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S, WorldSnapshot


class MinSpeed(Monitor):
    """Not slower than posted, less the tolerance, for longer than a moment, or on the whole, on a free lane.

    The excursion begins with the first slow tick; it becomes an event once it has lasted.
    """

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene) -> None:
        super().__init__(sign, rule, scene)
        self._zone = Zone(self)
        self._minimum = sign.posted
        self._under = self.excursion("under_minimum", smaller_is_worse=True)
        self._leaders = Leaders(scene.network)
        self._slow: list[WorldSnapshot] = []
        self._free, self._late, self._sum = 0, 0, 0.0
        self._last: WorldSnapshot | None = None

    def step(self, snapshot: WorldSnapshot) -> None:
        t = self.rule.thresholds
        past = self._zone.front(snapshot.ego)
        if past is None or past < t["settle_distance_m"]:
            self._end()
            return
        self.engaged = True
        threshold = self._minimum - t["tolerance_kmh"]
        speed = snapshot.ego.speed * KMH_PER_MPS
        if self._held_up(snapshot):
            self._end()
            return
        self._free, self._sum, self._last = self._free + 1, self._sum + speed, snapshot
        if speed >= threshold:
            self._end()
            return
        self._slow.append(snapshot)
        self._late += 1
        if self._under.open or snapshot.time - self._slow[0].time > t["duration_s"] + 1e-9:
            for tick in self._slow:
                self._under.broken(tick, tick.ego.speed * KMH_PER_MPS, threshold)
            self._slow.clear()

    def finish(self) -> Verdict:
        """An ego that was never slow for long may have been slow on the whole."""
        self._end()
        t = self.rule.thresholds
        if self._last is not None and not self.log.clauses() and self._late * DT_S > t["duration_s"] + DT_S / 2:
            mean, threshold = self._sum / self._free, self._minimum - t["tolerance_kmh"]
            if mean < threshold:
                self.log.event("under_minimum", self._last, self._last.time, mean, threshold)
                self.log.mark(self._last.step)
        return super().finish()

    def _end(self) -> None:
        self._under.close()
        self._slow.clear()

    def _held_up(self, snapshot: WorldSnapshot) -> bool:
        """Does a leader slower than the minimum drive on the ego's lane within the distance of the rule?"""
        t, ego = self.rule.thresholds, snapshot.ego
        reach = max(t["leader_min_m"], ego.speed**2 / t["leader_divisor_mps2"] + t["leader_margin_m"])
        ahead = self._leaders.within(snapshot, reach)
        return any(speed * KMH_PER_MPS < self._minimum for _, speed in ahead)
