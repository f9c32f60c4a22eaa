"""Does a vehicle with priority brake for the ego, or for something of its own? Units: m, s, m/s, m/s2.

Source: docs/rules.md, "Give way".
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from typing import NamedTuple

from tsbench.geometry.overlap import ConflictZone
from tsbench.roads.junction_paths import JunctionPath
from tsbench.roads.priority import PriorityVehicle
from tsbench.sim.world import DT_S, ActorKind, Actors, WorldSnapshot

# SUMO's states of a connection whose vehicles give way, or stop, at their own line.
_MINOR = "ms"
_TICK_SHARE_S = 1e-6


class HardBraking(NamedTuple):
    """One tick of a vehicle on a path: its deceleration, m/s2, and when it would have reached its zone without, s."""

    row: int
    path: int
    snapshot: WorldSnapshot
    hardness: float
    arrival: float


class ForcedBraking:
    """Deceleration from tick to tick while the ego passes.

    most: what is no force yet, m/s2. paths: those of the vehicles with priority. Short braking is force only where it
    was needed: without it the vehicle would have come too soon after the ego had left the zone.
    """

    def __init__(self, thresholds: Mapping[str, float], paths: Sequence[JunctionPath]) -> None:
        self.most = thresholds["forced_brake_mps2"]
        self._within = round(thresholds["forced_within_s"] / DT_S)
        self._after, self._long = thresholds["post_clear_s"], thresholds["forced_s"] - _TICK_SHARE_S
        self._leader_gap, self._least = thresholds["leader_gap_s"], thresholds["min_foe_speed_mps"]
        self._paths = paths
        self._last: dict[int, tuple[int, float]] = {}
        self._hard: list[HardBraking] = []

    def over(self, step: int, entries: Iterable[int]) -> bool:
        """Is it too late for any braking to be the ego's doing? entries: steps at which it entered the zones."""
        return step > max(entries, default=step) + self._within

    def watch(self, snapshot: WorldSnapshot, vehicle: PriorityVehicle, zone: ConflictZone) -> bool:
        """Take in a vehicle at this tick; does it come to a halt, for nothing of its own?"""
        seen, before = self._last.get(vehicle.row, (0, 0.0))
        self._last[vehicle.row] = snapshot.step, vehicle.speed
        hardness, halts = (before - vehicle.speed) / DT_S, vehicle.speed < self._least <= before
        if seen != snapshot.step - 1 or not (halts or hardness > self.most):
            return False
        if self._for_own_line(vehicle, before) or self._for_leader(snapshot.actors, vehicle, before):
            return False
        if hardness > self.most:
            arrival = snapshot.time + max(zone.b_in - vehicle.s, 0.0) / before
            self._hard.append(HardBraking(vehicle.row, vehicle.path, snapshot, hardness, arrival))
        return halts

    def for_ego(
        self, entries: Mapping[int, int], exits: Mapping[int, int], first: AbstractSet[int]
    ) -> Iterator[HardBraking]:
        """What was force from shortly before the ego's entry until it left the zone, or until shortly after the entry.

        entries, exits: steps at which the ego entered and left a zone, by path. first: rows that went before it.
        """
        ticks = Counter(one.row for one in self._hard)
        for one in self._hard:
            entry, out = entries.get(one.path), exits.get(one.path)
            if entry is None or one.row in first or one.snapshot.step < entry - self._within:
                continue
            if out is None or (
                one.snapshot.step <= max(out, entry + self._within)
                and (one.arrival - out * DT_S < self._after or ticks[one.row] * DT_S >= self._long)
            ):
                yield one

    def _for_own_line(self, vehicle: PriorityVehicle, before: float) -> bool:
        """Before its line, or in the tick in which it crosses it: does it give way, or slow down for its turn?"""
        path = self._paths[vehicle.path]
        slower = path.inner[0].speed < min(before, path.source.speed)
        return vehicle.s < vehicle.speed * DT_S and (slower or path.connection.state in _MINOR)

    def _for_leader(self, actors: Actors, vehicle: PriorityVehicle, before: float) -> bool:
        """Is a slower vehicle near ahead of it, on its path or its lane?"""
        path, own = self._paths[vehicle.path], int(actors.lane[vehicle.at])
        starts = {own: vehicle.s - float(actors.lane_s[vehicle.at]), path.target.index: path.line.length}
        at = 0.0
        for lane in path.inner:
            starts[lane.index] = at
            at += lane.line.length
        starts.setdefault(path.source.index, -path.source.line.length)
        reach = self._leader_gap * max(before, self._least)
        for k, lane in enumerate(actors.lane.tolist()):
            start = starts.get(lane)
            if start is None or k == vehicle.at or actors.kind[k] == ActorKind.PEDESTRIAN:
                continue
            rear = start + float(actors.lane_s[k]) - float(actors.length[k])
            if vehicle.s - vehicle.length < rear < vehicle.s + reach and float(actors.speed[k]) < before:
                return True
        return False
