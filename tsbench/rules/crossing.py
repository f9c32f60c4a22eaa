"""One passage of the ego through a junction whose other arms have priority, on a known path.

Source: docs/rules.md, "Give way". Units: m, s, m/s, m/s2.

Pedestrians on a crossing, or about to step onto it, in the ego's way. Units: m, m/s, rad.

Source: docs/rules.md, "Crosswalk".
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from tsbench.geometry.footprint import boxes_overlap
from tsbench.geometry.overlap import ConflictZone
from tsbench.roads.blocking import PriorityGap, blocker
from tsbench.roads.junction_paths import JunctionPath
from tsbench.roads.priority import PriorityVehicle, PriorityVehicles
from tsbench.roads.road_map import Crossing
from tsbench.rules.forced_braking import ForcedBraking
from tsbench.rules.monitor import EventLog
from tsbench.signs.catalog import RuleSpec
from tsbench.sim.world import DT_S, EGO_LENGTH_M, EGO_WIDTH_M, Actors, WorldSnapshot, ego_box


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


class PedestrianPlace(NamedTuple):
    """A pedestrian's: u along the crossing's middle line from one kerb (0) to the other, w across it.

    at: among the road users of the tick. row: in their table. direction: which way it walks along u (1 or -1).
    """

    at: int
    row: int
    u: float
    w: float
    direction: float


class CrossingPeople:
    """One crossing. thresholds: those of the rule `crosswalk`. Remembers which way each pedestrian walked last."""

    def __init__(self, crossing: Crossing, thresholds: Mapping[str, float]) -> None:
        (self._x, self._y), (x, y) = crossing.line.points[0].tolist(), crossing.line.points[-1].tolist()
        self.length, self.width = math.hypot(x - self._x, y - self._y), crossing.width
        self.heading = math.atan2(y - self._y, x - self._x)
        self.middle = (x + self._x) / 2, (y + self._y) / 2
        self._c, self._s = math.cos(self.heading), math.sin(self.heading)
        self._kerb, self._clear = thresholds["kerb_distance_m"], thresholds["clearance_m"]
        self._moving, self._along = thresholds["moving_mps"], thresholds["walks_along_cos"]
        self._across = thresholds["sweeps_across_sin"]
        self._direction: dict[int, float] = {}

    def places(self, actors: Actors, people: Sequence[int]) -> list[PedestrianPlace]:
        """Of the pedestrians among a tick's road users."""
        return [self._place(actors, at) for at in people]

    def anyone_in_the_way(self, x: float, y: float, heading: float, actors: Actors, people: Sequence[int]) -> bool:
        """Is a pedestrian on the crossing and not clear of the ego's strip, or about to step onto it?

        x, y, heading: a pose of the ego's, where it is or where it will cross; its strip goes straight on from there.
        """
        return any(
            self.past(x, y, heading, actors, p) < self._clear if self.is_on_it(p) else self.is_about_to_step(actors, p)
            for p in self.places(actors, people)
        )

    def is_on_it(self, place: PedestrianPlace) -> bool:
        """Is this place on the carriageway part of the crossing?"""
        return 0.0 <= place.u <= self.length and abs(place.w) <= self.width / 2

    def is_about_to_step(self, actors: Actors, place: PedestrianPlace) -> bool:
        """Is a pedestrian near the kerb, and walking towards it?"""
        at, _, u, w, _ = place
        outside = max(-u, u - self.length)
        if outside > self._kerb or abs(w) > self.width / 2 + self._kerb:
            return False
        towards = math.cos(float(actors.pose[at, 2]) - self.heading) * (1.0 if u < 0.0 else -1.0)
        return outside > 0.0 and towards >= self._along and float(actors.speed[at]) > self._moving

    def past(self, x: float, y: float, heading: float, actors: Actors, place: PedestrianPlace) -> float:
        """How far a pedestrian has got beyond the strip swept from a pose of the ego's (< 0: before it or in it)."""
        _, row, u, w, direction = place
        dx, dy = x - self._x, y - self._y
        ego_u, ego_w = dx * self._c + dy * self._s, dy * self._c - dx * self._s
        turn = heading - self.heading
        along, across = math.cos(turn), math.sin(turn)
        if abs(across) >= self._across:
            # Where the ego's middle line passes this pedestrian's track.
            ego_u += (w - ego_w) * along / across
        half = EGO_WIDTH_M / 2 / max(abs(across), self._across)
        return float(direction * (u - ego_u) - half - actors.table.length[row] / 2)

    def _place(self, actors: Actors, at: int) -> PedestrianPlace:
        x, y, heading = actors.pose[at].tolist()
        dx, dy = x - self._x, y - self._y
        u, w = dx * self._c + dy * self._s, dy * self._c - dx * self._s
        row, along = int(actors.index[at]), math.cos(heading - self.heading)
        if abs(along) >= self._along:
            self._direction[row] = math.copysign(1.0, along)
        return PedestrianPlace(at, row, u, w, self._direction.setdefault(row, 1.0 if 2.0 * u < self.length else -1.0))
