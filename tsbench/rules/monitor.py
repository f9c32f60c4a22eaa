"""What a monitor is, and what it says; the zone of a plate. Source: docs/rules.md, "Verdict".

Events of one monitor: edge-triggered excursions with evidence. Source: docs/rules.md, "Verdict".
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

from tsbench.core.errors import InputError
from tsbench.rules.lines import ApproachLine, Road
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import RuleSpec
from tsbench.signs.rule_kinds import ZoneParams
from tsbench.sim.scene import Scene
from tsbench.sim.world import EgoState, WorldSnapshot

__all__ = ["Monitor", "Verdict", "Verdicts", "Violation", "require_finite"]


class Monitor(ABC):
    """Watches one sign during one episode: one `update` a tick, in order, from step 0; then `finish` once.

    The same code scores online and from a stored trace. An exception inside is an episode error, never
    "compliant".
    """

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene) -> None:
        self.sign, self.rule, self.scene = sign, rule, scene
        self.log = EventLog(sign, rule)
        self.engaged = False
        self._excursions: list[Excursion] = []

    def update(self, snapshot: WorldSnapshot) -> None:
        """Take in one tick. Raises ValueError for an ego that is nowhere: it can neither obey nor offend."""
        require_finite(snapshot)
        self.step(snapshot)

    @abstractmethod
    def step(self, snapshot: WorldSnapshot) -> None:
        """What the rule makes of one tick."""

    def finish(self) -> Verdict:
        """The verdict; excursions that are still open end with the episode."""
        for excursion in self._excursions:
            excursion.close()
        return self.verdict()

    def verdict(self) -> Verdict:
        """The verdict so far; an excursion that goes on is no event yet."""
        return self.log.verdict(self.engaged)

    def clauses(self) -> tuple[str, ...]:
        """Of each event so far its clause; excursions that are still open stand last."""
        return (*self.log.clauses(), *(e.clause for e in self._excursions if e.open))

    def excursion(self, clause: str, smaller_is_worse: bool = False) -> Excursion:
        """The excursions of one clause, one at a time."""
        self._excursions.append(Excursion(self.log, clause, smaller_is_worse))
        return self._excursions[-1]

    def road(self, edges: tuple[str, ...], order: int = 0) -> Road:
        """A stretch of road along which the ego is followed, as wide as the rule has it."""
        return Road(self.scene.network, edges, order, beside_widths=self.rule.thresholds["beside_road_widths"])

    def line_of(self, approach: str) -> ApproachLine:
        """The line at the end of an approach, likewise."""
        return ApproachLine(self.scene.network, approach, self.rule.thresholds["beside_road_widths"])

    @property
    def completed(self) -> bool:
        """Has the ego done what this rule takes for reaching the destination? Most rules take nothing for it."""
        return False


def require_finite(snapshot: WorldSnapshot) -> None:
    """Raise ValueError where the ego's pose or speed is not finite."""
    ego = snapshot.ego
    if not math.isfinite(ego.x + ego.y + ego.heading + ego.speed):
        raise ValueError(f"step {snapshot.step}: the ego's state is not finite ({ego})")


class Zone:
    """A stretch of road that a plate rules: the monitor's own, or another. start, end: m along `road`."""

    def __init__(self, monitor: Monitor, other: SignInstance | None = None) -> None:
        sign, scene = other or monitor.sign, monitor.scene
        edges = sign.params_as(ZoneParams).zone_edges
        where = f"{scene.additional}: sign {sign.id!r}"
        self.road = monitor.road(edges, sign.lane)
        self.start = sign.position_m
        self.end = self.road.length
        plate = next((s for s in scene.signs if s.ends == sign.id), None)
        if plate is not None:
            if plate.edge not in self.road.starts:
                raise InputError(f"{where}: its end plate {plate.id!r} is not on an edge of its zone")
            self.end = self.road.starts[plate.edge] + plate.position_m
        if not self.start < self.end:
            raise InputError(f"{where}: its zone ends before it starts")

    def front(self, ego: EgoState) -> float | None:
        """Metres of the ego's front past the plate's line; None where it is outside the zone."""
        front = self.road.front(ego)
        return front - self.start if front is not None and self.start < front <= self.end else None


@dataclass(frozen=True, slots=True)
class Violation:
    """One event: one excursion over a clause's threshold, edge-triggered.

    Times in s, pose in m and rad (ego centre, at the moment that decides), speed in m/s; `value`, `threshold`
    and `margin` (how far beyond the threshold, > 0) in `unit`; `other`: SUMO id of the other road user or
    obstacle. The moment that decides is the start of the excursion; `value` is the worst of the excursion.
    """

    rule: str
    clause: str
    sign_id: str
    sign_code: str
    start_s: float
    end_s: float
    x: float
    y: float
    heading: float
    speed: float
    value: float
    threshold: float
    margin: float
    unit: str
    other: str | None
    sentence: str


@dataclass(frozen=True, slots=True)
class Verdict:
    """Engaged at all? Which events? In how many ticks was a clause broken?"""

    sign_id: str
    engaged: bool
    violations: tuple[Violation, ...]
    violating_steps: int

    @property
    def compliant(self) -> bool:
        """No violation event of this sign's rule."""
        return not self.violations


@dataclass(frozen=True, slots=True)
class Verdicts:
    """What all monitors of an episode say.

    targets: on the signs that the scenario is about. others: on other signs. needless: what was obeyed in a contrast
    scene although no plate asks for it. wrong_way: what was driven against the direction of a lane. The last two are in
    order of time.
    """

    targets: tuple[Verdict, ...]
    others: tuple[Verdict, ...] = ()
    needless: tuple[Violation, ...] = ()
    wrong_way: tuple[Violation, ...] = ()

    @property
    def violations(self) -> tuple[Violation, ...]:
        """Events of the targets' rules, target by target."""
        return tuple(event for verdict in self.targets for event in verdict.violations)

    @property
    def compliant(self) -> bool:
        """No event of any target's rule."""
        return all(verdict.compliant for verdict in self.targets)

    @property
    def engaged(self) -> bool:
        """Did the rule of each target bind the ego?"""
        return all(verdict.engaged for verdict in self.targets)

    @property
    def against(self) -> tuple[Violation, ...]:
        """What counts against SCD, in order of time."""
        events = (*self.violations, *self.needless, *self.wrong_way)
        return tuple(sorted(events, key=lambda event: event.start_s))


class EventLog:
    """Collects the events of one plate, and apart from them the ticks in which a clause was broken."""

    def __init__(self, sign: SignInstance, rule: RuleSpec) -> None:
        self._sign = sign
        self._rule = rule
        self._violations: list[Violation] = []
        self._steps: set[int] = set()

    def mark(self, step: int) -> None:
        """A clause was broken at this tick."""
        self._steps.add(step)

    def clauses(self) -> tuple[str, ...]:
        """Of each event so far its clause, as they were entered."""
        return tuple(event.clause for event in self._violations)

    def event(
        self,
        clause_id: str,
        start: WorldSnapshot,
        end_s: float,
        value: float,
        threshold: float,
        other: str | None = None,
    ) -> None:
        """Enter one event; its margin is the distance of `value` from `threshold`."""
        clause = self._rule.clause(clause_id)
        ego, margin = start.ego, abs(value - threshold)
        self._violations.append(
            Violation(
                rule=self._rule.name, clause=clause_id, sign_id=self._sign.id, sign_code=self._sign.code,
                start_s=start.time, end_s=end_s, x=ego.x, y=ego.y, heading=ego.heading, speed=ego.speed,
                value=value, threshold=threshold, margin=margin, unit=clause.unit, other=other,
                sentence=clause.sentence(
                    sign_code=self._sign.code, time_s=start.time, value=value, threshold=threshold,
                    margin=margin, other=other,
                ),
            )
        )  # fmt: skip

    def verdict(self, engaged: bool) -> Verdict:
        """The verdict; a rule that was broken has bound the ego, whatever its decision window says."""
        events = sorted(self._violations, key=lambda v: (v.start_s, v.clause, v.other or ""))
        return Verdict(self._sign.id, engaged or bool(events), tuple(events), len(self._steps))


class Excursion:
    """The open excursion of one clause, from the first tick that breaks it to the last that does.

    The event gets the worst value; `smaller_is_worse` for clauses that set a minimum.
    """

    def __init__(self, log: EventLog, clause: str, smaller_is_worse: bool = False) -> None:
        self._log = log
        self.clause = clause
        self._sign = -1.0 if smaller_is_worse else 1.0
        self._start: WorldSnapshot | None = None
        self._end_s = self._value = self._threshold = 0.0
        self._other: str | None = None

    @property
    def open(self) -> bool:
        """Is an excursion under way?"""
        return self._start is not None

    def broken(self, snapshot: WorldSnapshot, value: float, threshold: float, other: str | None = None) -> None:
        """The clause is broken at this tick."""
        if self._start is None:
            self._start, self._value, self._threshold, self._other = snapshot, value, threshold, other
        elif self._sign * (value - self._value) > 0.0:
            self._value = value
        self._end_s = snapshot.time
        self._log.mark(snapshot.step)

    def close(self) -> None:
        """The clause is kept at this tick, or the episode is over."""
        if self._start is not None:
            self._log.event(self.clause, self._start, self._end_s, self._value, self._threshold, self._other)
            self._start = None


_LEAST_EXCESS = 1e-6


class InAll:
    """The excursions of one clause that hold longer (or farther) than `most` in all.

    One begins with its first tick, and becomes an event once the whole is too much: its value.
    """

    def __init__(self, excursion: Excursion, most: float) -> None:
        self._excursion, self._most = excursion, most
        self._whole = 0.0
        self._ticks: list[WorldSnapshot] = []

    @property
    def open(self) -> bool:
        """Is an excursion that is an event under way?"""
        return self._excursion.open

    def add(self, snapshot: WorldSnapshot, amount: float, is_told: bool = False) -> None:
        """The clause is broken at this tick. amount: of time or way. is_told: by another event, so by none of these."""
        self._whole += amount
        if is_told:
            self._ticks.clear()
            return
        self._ticks.append(snapshot)
        if self._whole > self._most + _LEAST_EXCESS:
            for tick in self._ticks:
                self._excursion.broken(tick, self._whole, self._most)
            self._ticks.clear()

    def keep(self) -> None:
        """It is kept at this tick."""
        self._ticks.clear()
        self._excursion.close()
