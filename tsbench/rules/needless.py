"""Needless obedience: what is asked beside the rule of a contrast scene's plate. Source: docs/spec/contrast.md.

Units: m, s, m/s.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from tsbench.geometry.polyline import bend_speed
from tsbench.rules.base import Monitor
from tsbench.rules.events import Verdict
from tsbench.rules.leaders import Leaders
from tsbench.rules.passage import Passage
from tsbench.rules.speed import KMH_PER_MPS
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import Catalog, RuleSpec
from tsbench.signs.contrast import ContrastClause, PassageParams, SlowZoneParams, WayParams
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S, WorldSnapshot


class Needless(Monitor):
    """One clause of a contrast scene; its events stand beside those of the plate `sign`."""

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene, clause: ContrastClause) -> None:
        super().__init__(sign, rule, scene)
        self.begin(clause)

    def begin(self, clause: ContrastClause) -> None:
        """Read the clause's params."""
        raise NotImplementedError


class NeedlessStop(Needless):
    """Has the ego stood on its passage for nobody, longer than a moment in all?"""

    def begin(self, clause: ContrastClause) -> None:
        assert isinstance(clause.params, PassageParams)
        self._passage = Passage(self, clause.params)
        self._stood = 0.0
        self._event = self.excursion("needless_stop")

    def step(self, snapshot: WorldSnapshot) -> None:
        t = self.rule.thresholds
        if not self._passage.on_it(snapshot) or snapshot.ego.speed >= t["standing_mps"]:
            return
        if self._passage.blocked(snapshot) or self._passage.leader(snapshot) < t["standing_mps"]:
            return
        self._stood += DT_S
        if self._stood > t["standing_s"] + DT_S / 2:
            self._event.broken(snapshot, self._stood, t["standing_s"])


class NeedlessYield(Needless):
    """Has the passage taken much longer than at the speed that was open to the ego?

    That is the fastest at which it has been until then, at its start included: who has come slowly to see what the
    others will do, has no open road for an excuse. Ticks in which somebody blocks do not count.
    """

    def begin(self, clause: ContrastClause) -> None:
        assert isinstance(clause.params, PassageParams)
        self._passage = Passage(self, clause.params)
        self._turn = self._passage.turn_speed(self.rule.thresholds["lateral_mps2"])
        self._fastest = self.scene.start.speed
        self._ticks: list[tuple[float, float]] = []
        self._was = False

    def step(self, snapshot: WorldSnapshot) -> None:
        ego, passage = snapshot.ego, self._passage
        self._fastest = max(self._fastest, ego.speed)
        on_it = passage.on_it(snapshot)
        if on_it and not passage.blocked(snapshot):
            lane = self.scene.network.lanes[ego.lane] if ego.lane >= 0 else None
            cap = passage.leader(snapshot)
            if lane is not None:
                cap = min(cap, lane.speed, self._turn if lane.internal else lane.speed)
            self._ticks.append((ego.speed, cap))
        if self._was and not on_it and passage.through:
            self._judge(snapshot)
        self._was = on_it

    def _judge(self, snapshot: WorldSnapshot) -> None:
        t = self.rule.thresholds
        took = DT_S * len(self._ticks)
        least = t["standing_mps"]
        free = sum(DT_S * v / max(min(self._fastest, cap), least) for v, cap in self._ticks)
        if took > t["passage_time_ratio"] * free:
            self.log.mark(snapshot.step)
            self.log.event("needless_yield", snapshot, snapshot.time, took, t["passage_time_ratio"] * free)
        self._ticks.clear()


class NeedlessSlow(Needless):
    """The mean speed over the zone, against what limit, bend and leader left open."""

    def begin(self, clause: ContrastClause) -> None:
        p, t = clause.params, self.rule.thresholds
        assert isinstance(p, SlowZoneParams)
        self._road = self.road(p.zone_edges)
        self._start, self._end = p.start_m, min(p.end_m, p.start_m + t["slow_zone_m"])
        bend = bend_speed(self._road.line.slice(self._start, self._end), t["lateral_mps2"])
        self._cap = min(p.limit_kmh / KMH_PER_MPS, bend)
        self._leaders = Leaders(self.scene.network)
        self._ticks: list[tuple[float, float]] = []

    def step(self, snapshot: WorldSnapshot) -> None:
        front, ego = self._road.front(snapshot.ego), snapshot.ego
        if front is not None and self._start <= front <= self._end:
            reach = self.rule.thresholds["leader_gap_s"] * ego.speed
            led = min((v for _, v in self._leaders.within(snapshot, reach)), default=self._cap)
            self._ticks.append((ego.speed, min(self._cap, led)))
        elif self._ticks:
            count, ratio = len(self._ticks), self.rule.thresholds["slow_speed_ratio"]
            mean, least = (
                sum(v for v, _ in self._ticks) / count,
                ratio * sum(c for _, c in self._ticks) / count,
            )
            if mean < least:
                self.log.mark(snapshot.step)
                self.log.event("needless_slow", snapshot, snapshot.time, mean, least)
            self._ticks.clear()


class NeedlessDetour(Needless):
    """Has the ego left the navigation's way, or lane, for longer than a moment?"""

    def begin(self, clause: ContrastClause) -> None:
        p = clause.params
        assert isinstance(p, WayParams)
        network = self.scene.network
        self._approach, self._exits = p.approach, frozenset(p.exits)
        self._lanes = frozenset(network.lane(name).index for name in p.lanes)
        self._edges = {network.lane(name).edge for name in p.lanes}
        self._armed, self._off_s = False, 0.0
        self._event = self.excursion("needless_detour")

    def step(self, snapshot: WorldSnapshot) -> None:
        if self._is_off(snapshot.ego.lane):
            self._off_s += DT_S
            most = self.rule.thresholds["lane_s"]
            if self._off_s > most + DT_S / 2:
                self._event.broken(snapshot, self._off_s, most)
        else:
            self._off_s = 0.0
            self._event.close()

    def _is_off(self, index: int) -> bool:
        if index < 0:
            return False
        lane = self.scene.network.lanes[index]
        if lane.internal:
            return False
        if lane.edge == self._approach:
            self._armed = True
            return False
        if self._exits and self._armed:
            if lane.edge not in self._exits:
                return True
            self._armed = False
        return lane.edge in self._edges and index not in self._lanes


_CLAUSES: Mapping[str, type[Needless]] = MappingProxyType(
    {
        "needless_stop": NeedlessStop,
        "needless_yield": NeedlessYield,
        "needless_slow": NeedlessSlow,
        "needless_detour": NeedlessDetour,
    }
)


class ContrastTarget(Monitor):
    """The plate's own monitor and those of the scene's clauses, as one: it is obeyed where none has an event."""

    def __init__(self, plate: Monitor, catalog: Catalog) -> None:
        super().__init__(plate.sign, plate.rule, plate.scene)
        self._plate = plate
        self._clauses = [
            _CLAUSES[c.name](plate.sign, catalog.needless, plate.scene, c) for c in plate.scene.contrast
        ]

    def step(self, snapshot: WorldSnapshot) -> None:
        for part in (self._plate, *self._clauses):
            part.update(snapshot)

    @property
    def completed(self) -> bool:
        """As the plate's rule has it."""
        return self._plate.completed

    def finish(self) -> Verdict:
        """Engaged as the plate's rule is; the events of all, in order of time."""
        own, *others = (part.finish() for part in (self._plate, *self._clauses))
        events = sorted(
            (v for verdict in (own, *others) for v in verdict.violations), key=lambda v: (v.start_s, v.clause)
        )
        steps = own.violating_steps + sum(verdict.violating_steps for verdict in others)
        return Verdict(own.sign_id, own.engaged, tuple(events), steps)
