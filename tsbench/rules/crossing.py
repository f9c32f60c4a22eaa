"""One passage of the ego through a junction whose other arms have priority, on a known path.

Source: docs/rules.md, "Give way". Units: m, s, m/s, m/s2.
"""

from __future__ import annotations

from collections.abc import Sequence

from tsbench.geometry.footprint import boxes_overlap
from tsbench.geometry.overlap import ConflictZone
from tsbench.roads.blocking import PriorityGap, blocker
from tsbench.roads.junction_paths import JunctionPath
from tsbench.roads.priority import PriorityVehicle, PriorityVehicles
from tsbench.rules.events import EventLog
from tsbench.rules.forced_braking import ForcedBraking
from tsbench.signs.catalog import RuleSpec
from tsbench.sim.world import DT_S, EGO_LENGTH_M, WorldSnapshot, ego_box


class _Offence:
    """One clause against one vehicle: its ticks, and the value that is farthest beyond the threshold."""

    def __init__(self, start: WorldSnapshot, value: float, threshold: float) -> None:
        self.start, self.end, self.value, self.threshold = start, start, value, threshold
        self.steps: list[int] = []

    def add(self, snapshot: WorldSnapshot, value: float) -> None:
        """One more tick."""
        self.end = snapshot
        self.steps.append(snapshot.step)
        if abs(value - self.threshold) > abs(self.value - self.threshold):
            self.value = value


class WorstPerVehicle:
    """Collects the ticks at which clauses were broken. clauses: the gravest first."""

    def __init__(self, log: EventLog, clauses: Sequence[str]) -> None:
        self._log, self._clauses = log, clauses
        self._found: dict[int, dict[str, _Offence]] = {}

    def note(self, row: int, clause: str, snapshot: WorldSnapshot, value: float, threshold: float) -> None:
        """A clause is broken at this tick against the road user of a row."""
        offences = self._found.setdefault(row, {})
        if clause not in offences:
            offences[clause] = _Offence(snapshot, value, threshold)
        offences[clause].add(snapshot, value)

    def close(self) -> None:
        """Enter one event for each road user."""
        for row, offences in self._found.items():
            clause = next(c for c in self._clauses if c in offences)
            found = offences[clause]
            other = found.start.actors.table.ids[row]
            self._log.event(clause, found.start, found.end.time, found.value, found.threshold, other)
            for step in found.steps:
                self._log.mark(step)
        self._found = {}


_HALF_M = EGO_LENGTH_M / 2
_WINDOW_M = 6.0
_GRAVEST_FIRST = ("contact", "forced_braking", "encroached", "entered_while_blocked")

# By path of the other vehicle: the conflict zone with the ego's path (a: ego, b: other).
Zones = tuple[ConflictZone | None, ...]


class CrossingJudge:
    """Judges the ticks from the one at which the ego's front has crossed the line. Every event is one vehicle's."""

    def __init__(
        self,
        path: JunctionPath,
        zones: Zones,
        priority_paths: tuple[JunctionPath, ...],
        vehicles: PriorityVehicles,
        rule: RuleSpec,
        log: EventLog,
    ) -> None:
        self._path, self._zones, self._priority_paths = path, zones, priority_paths
        self._priority_vehicles, self._found = vehicles, WorstPerVehicle(log, _GRAVEST_FIRST)
        self._asked = PriorityGap.of(rule.thresholds)
        self._braking = ForcedBraking(rule.thresholds, priority_paths)
        self._s = -_HALF_M
        self._in: dict[int, int] = {}
        self._out: dict[int, int] = {}
        self._first: set[int] = set()
        self._met: set[int] = set()
        self._coming: set[tuple[int, int]] = set()
        self.done = False

    def update(self, snapshot: WorldSnapshot) -> None:
        """Take in one tick."""
        ego, step = snapshot.ego, snapshot.step
        # A window: the two legs of a U-turn lie side by side.
        self._s, _ = self._path.line.project(ego.x, ego.y, self._s - _WINDOW_M, self._s + _WINDOW_M)
        for j, zone in enumerate(self._zones):
            if zone is not None:
                if self._s + _HALF_M >= zone.a_in:
                    self._in.setdefault(j, step)
                if self._s - _HALF_M > zone.a_out:
                    self._out.setdefault(j, step)
        left = self._s - _HALF_M > self._path.line.length
        for vehicle in self._priority_vehicles.find(snapshot.actors):
            zone = self._zones[vehicle.path]
            if zone is not None:
                self._judge_entry(snapshot, vehicle, zone)
                halts = self._braking.watch(snapshot, vehicle, zone)
                self._judge_meeting(snapshot, vehicle, zone, halts)
            if not left:
                self._judge_contact(snapshot, vehicle)
        if left:
            waited = (step - max(self._out.values(), default=step)) * DT_S
            self.done = not self._out or (waited >= self._asked.after and self._braking.over(step, self._in.values()))

    def close(self) -> None:
        """Clause forced_braking, for all ticks; then enter what was found."""
        for one in self._braking.for_ego(self._in, self._out, self._first):
            self._found.note(one.row, "forced_braking", one.snapshot, one.hardness, self._braking.most)
        self._found.close()

    def _judge_entry(self, snapshot: WorldSnapshot, vehicle: PriorityVehicle, zone: ConflictZone) -> None:
        """Clause entered_while_blocked, at the tick when the ego's front enters a zone."""
        entry = self._in.get(vehicle.path, snapshot.step + 1)
        if entry >= snapshot.step and vehicle.s >= zone.b_in:
            self._first.add(vehicle.row)
        if entry != snapshot.step:
            return
        found = blocker(vehicle, zone, self._s + _HALF_M, snapshot.ego.speed, self._asked)
        if found is not None:
            self._found.note(vehicle.row, "entered_while_blocked", snapshot, found.gap, found.asked)

    def _judge_meeting(
        self, snapshot: WorldSnapshot, vehicle: PriorityVehicle, zone: ConflictZone, halts: bool
    ) -> None:
        """Clause encroached, at the tick when a vehicle's front reaches the zone, or when it halts before it."""
        if vehicle.row in self._met:
            return
        step, asked = snapshot.step, self._asked.after
        if vehicle.s < zone.b_in:
            self._coming.add((vehicle.row, vehicle.path))
            entry, out = self._in.get(vehicle.path, step), self._out.get(vehicle.path, step + 1)
            if halts and entry < step < out:
                self._found.note(vehicle.row, "encroached", snapshot, 0.0, asked)
            return
        self._met.add(vehicle.row)
        if (vehicle.row, vehicle.path) not in self._coming:
            return  # it was past the zone, or comes onto this path behind it, from the lane beside
        if self._in.get(vehicle.path, step) >= step:
            return  # the other one is first, or both come at once
        after = (step - self._out.get(vehicle.path, step)) * DT_S
        if after < asked:
            self._found.note(vehicle.row, "encroached", snapshot, after, asked)

    def _judge_contact(self, snapshot: WorldSnapshot, vehicle: PriorityVehicle) -> None:
        """Clause contact: neither has left the junction."""
        actors, ego = snapshot.actors, snapshot.ego
        if vehicle.s - vehicle.length > self._priority_paths[vehicle.path].line.length:
            return
        size = vehicle.length, float(actors.table.width[vehicle.row])
        x, y, heading = actors.pose[vehicle.at].tolist()
        if boxes_overlap(*ego_box(ego), x, y, heading, *size):
            self._found.note(vehicle.row, "contact", snapshot, 1.0, 0.0)
