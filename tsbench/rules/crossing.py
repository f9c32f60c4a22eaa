"""One passage of the ego through a junction whose other arms have priority, on a known path.

Source: docs/spec/rules.md, "Give way". Units: m, s, m/s.
"""

from __future__ import annotations

from tsbench.geometry.footprint import boxes_overlap
from tsbench.geometry.overlap import ConflictZone
from tsbench.roads.junction_paths import JunctionPath
from tsbench.roads.priority import PriorityVehicle, PriorityVehicles
from tsbench.rules.events import EventLog, Excursion
from tsbench.signs.catalog import RuleSpec
from tsbench.sim.world import DT_S, EGO_LENGTH_M, EGO_WIDTH_M, WorldSnapshot

_HALF_M = EGO_LENGTH_M / 2
_WINDOW_M = 6.0

# By path of the other vehicle: the conflict zone with the ego's path (a: ego, b: other).
Zones = tuple[ConflictZone | None, ...]


def arrival_s(vehicle: PriorityVehicle, zone: ConflictZone, least_speed: float) -> float | None:
    """Seconds until a vehicle reaches its zone, 0 while it is in it; None when it has cleared it."""
    if vehicle.s - vehicle.length > zone.b_out:
        return None
    return max(zone.b_in - vehicle.s, 0.0) / max(vehicle.speed, least_speed)


class Crossing:
    """Judges the ticks from the one at which the ego's front has crossed the line."""

    def __init__(
        self,
        path: JunctionPath,
        zones: Zones,
        foe_paths: tuple[JunctionPath, ...],
        vehicles: PriorityVehicles,
        rule: RuleSpec,
        log: EventLog,
    ) -> None:
        self._path, self._zones, self._foe_paths = path, zones, foe_paths
        self._foes, self._log = vehicles, log
        self._gap, self._least = rule.thresholds["gap_s"], rule.thresholds["min_foe_speed_mps"]
        self._post_clear = rule.thresholds["post_clear_s"]
        self._s = -_HALF_M
        self._first = True
        self._in: dict[int, int] = {}
        self._out: dict[int, int] = {}
        self._met: set[int] = set()
        self._coming: set[tuple[int, int]] = set()
        self._touch: dict[int, Excursion] = {}
        self.done = False

    def update(self, snapshot: WorldSnapshot) -> None:
        """Take in one tick."""
        ego, step = snapshot.ego, snapshot.step
        # A window: the two legs of a U-turn lie side by side.
        self._s, _ = self._path.line.project(ego.x, ego.y, self._s - _WINDOW_M, self._s + _WINDOW_M)
        vehicles = self._foes.find(snapshot.actors)
        if self._first:
            self._first = False
            self._judge_entry(snapshot, vehicles)
        for j, zone in enumerate(self._zones):
            if zone is not None:
                if self._s + _HALF_M >= zone.a_in:
                    self._in.setdefault(j, step)
                if self._s - _HALF_M > zone.a_out:
                    self._out.setdefault(j, step)
        left = self._s - _HALF_M > self._path.line.length
        for vehicle in vehicles:
            self._judge_meeting(snapshot, vehicle)
            if not left:
                self._judge_contact(snapshot, vehicle)
        if left:
            self.close()
            waited = (step - max(self._out.values(), default=step)) * DT_S
            self.done = not self._out or waited >= self._post_clear

    def close(self) -> None:
        """End open contacts."""
        for excursion in self._touch.values():
            excursion.close()

    def _judge_entry(self, snapshot: WorldSnapshot, vehicles: list[PriorityVehicle]) -> None:
        """Clause entered_while_blocked: the vehicle that would be there first stands for all that block."""
        arrivals = []
        for vehicle in vehicles:
            zone = self._zones[vehicle.path]
            arrival = None if zone is None else arrival_s(vehicle, zone, self._least)
            if arrival is not None and arrival < self._gap:
                arrivals.append((arrival, vehicle.at, vehicle.row))
        if arrivals:
            arrival, _, row = min(arrivals)
            other = snapshot.actors.table.ids[row]
            self._log.event("entered_while_blocked", snapshot, snapshot.time, arrival, self._gap, other)
            self._log.mark(snapshot.step)

    def _judge_meeting(self, snapshot: WorldSnapshot, vehicle: PriorityVehicle) -> None:
        """Clause encroached, judged once per vehicle, at the tick when its front reaches the zone."""
        zone = self._zones[vehicle.path]
        if zone is None or vehicle.row in self._met:
            return
        if vehicle.s < zone.b_in:
            self._coming.add((vehicle.row, vehicle.path))
            return
        self._met.add(vehicle.row)
        if (vehicle.row, vehicle.path) not in self._coming:
            return  # it was past the zone, or comes onto this path behind it, from the lane beside
        step = snapshot.step
        if self._in.get(vehicle.path, step) >= step:
            return  # the other one is first, or both come at once
        after = (step - self._out.get(vehicle.path, step)) * DT_S
        if after < self._post_clear:
            other = snapshot.actors.table.ids[vehicle.row]
            self._log.event("encroached", snapshot, snapshot.time, after, self._post_clear, other)
            self._log.mark(step)

    def _judge_contact(self, snapshot: WorldSnapshot, vehicle: PriorityVehicle) -> None:
        """Clause contact: neither has left the junction."""
        actors, ego = snapshot.actors, snapshot.ego
        x, y, heading = actors.pose[vehicle.at].tolist()
        touching = vehicle.s - vehicle.length <= self._foe_paths[vehicle.path].line.length and boxes_overlap(
            ego.x, ego.y, ego.heading, EGO_LENGTH_M, EGO_WIDTH_M,
            x, y, heading, vehicle.length, float(actors.table.width[vehicle.row]),
        )  # fmt: skip
        excursion = self._touch.get(vehicle.row)
        if touching:
            if excursion is None:
                excursion = self._touch[vehicle.row] = Excursion(self._log, "contact")
            excursion.broken(snapshot, 1.0, 0.0, actors.table.ids[vehicle.row])
        elif excursion is not None:
            excursion.close()
