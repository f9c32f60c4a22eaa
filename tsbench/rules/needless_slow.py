"""Driving slowly where nothing asks for it. Source: docs/contrast.md, "Needless obedience". Units: m, m/s."""

from __future__ import annotations

from tsbench.rules.monitor import Monitor, Verdict
from tsbench.rules.open_speed import MeanSpeeds, OpenSpeed, OtherLimits, at_metre, bend_speeds
from tsbench.rules.speed import KMH_PER_MPS
from tsbench.signs.annotations import SignInstance
from tsbench.signs.contrast import SlowZoneParams
from tsbench.sim.scene import Scene
from tsbench.sim.world import WorldSnapshot


class NeedlessSlow(Monitor):
    """The mean speed up to the zone and that over it, each against that of the speed that was open."""

    def __init__(self, params: SlowZoneParams, sign: SignInstance, scene: Scene) -> None:
        super().__init__(sign, scene.catalog.needless, scene)
        self._road = self.road(params.zone_edges)
        self._start = params.start_m
        self._end = min(params.end_m, params.start_m + self.rule.thresholds["slow_zone_m"])
        self._limit = params.limit_kmh / KMH_PER_MPS
        self._bends = bend_speeds(self._road.line, self.rule)
        self._open, self._means = OpenSpeed(scene.network, self.rule), MeanSpeeds()
        self._others = OtherLimits(self)
        self._last: WorldSnapshot | None = None
        self._front: float | None = None

    def step(self, snapshot: WorldSnapshot) -> None:
        """One tick."""
        before, front = self._front, self._road.front(snapshot.ego)
        if front is not None:
            self._front = front
        most = self._others.at(snapshot.ego)
        if self._front is None or self._front > self._end:
            self._open.update(snapshot, most)
            self._judge()
            return
        most = min(most, at_metre(self._bends, self._front))
        if self._front >= self._start:
            most = min(self._limit, most)
            if before is not None and before < self._start:
                self._judge()
        speed = self._open.update(snapshot, most)
        self._means.add(snapshot.ego.speed, speed)
        self._last = snapshot

    def finish(self) -> Verdict:
        """A zone in which the episode ends is judged as far as it went."""
        self._judge()
        return super().finish()

    def _judge(self) -> None:
        t = self.rule.thresholds
        slow = self._means.taken(t["slow_speed_ratio"], t["least_difference_mps"])
        if slow is not None and self._last is not None:
            self.log.mark(self._last.step)
            self.log.event("needless_slow", self._last, self._last.time, *slow)
