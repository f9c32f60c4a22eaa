"""Which vehicles with priority block the ego: one for rules and experts. Source: docs/rules.md, "Give way".

Units: m, s, m/s.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from tsbench.geometry.overlap import ConflictZone
from tsbench.roads.priority import PriorityVehicle


@dataclass(frozen=True, slots=True)
class PriorityGap:
    """What is to be left to a vehicle with priority.

    before: who would reach the zone sooner blocks. after: so long after who is in the zone has left a piece of ground
    the ego may reach it. least: what speeds are counted as at least.
    """

    before: float
    after: float
    least: float

    @classmethod
    def of(cls, thresholds: Mapping[str, float]) -> PriorityGap:
        """From the thresholds of `give_way`, or of a rule that has them too."""
        return cls(thresholds["gap_s"], thresholds["post_clear_s"], thresholds["min_foe_speed_mps"])


class Blocker(NamedTuple):
    """A vehicle that blocks: the gap that it leaves the ego (s, < 0: both on one ground at once), and what is asked."""

    vehicle: PriorityVehicle
    gap: float
    asked: float


def arrival_s(vehicle: PriorityVehicle, zone: ConflictZone, least: float) -> float | None:
    """Seconds until a vehicle reaches its zone; None where it has."""
    to_go = zone.b_in - vehicle.s
    return to_go / max(vehicle.speed, least) if to_go > 0.0 else None


def clearance_s(vehicle: PriorityVehicle, zone: ConflictZone, front: float, speed: float, least: float) -> float | None:
    """For a vehicle in its zone: the least time between its rear's leaving a piece of ground and the ego's reaching it.

    front: the ego's, along its path. < 0 where the ego would be there first; None where nothing is left to sweep.
    """
    rear, theirs, own = vehicle.s - vehicle.length, max(vehicle.speed, least), max(speed, least)
    return min((max(a - front, 0.0) / own - (b - rear) / theirs for b, a in zone.ground if b > rear), default=None)


def blocker(
    vehicle: PriorityVehicle, zone: ConflictZone | None, front: float, speed: float, asked: PriorityGap
) -> Blocker | None:
    """The vehicle as one that blocks an ego whose front is at `front` on its path; None where it does not."""
    if zone is None:
        return None
    gap, least = arrival_s(vehicle, zone, asked.least), asked.before
    if gap is None:
        gap, least = clearance_s(vehicle, zone, front, speed, asked.least), asked.after
    return None if gap is None or gap >= least else Blocker(vehicle, gap, least)


def blockers(
    vehicles: Iterable[PriorityVehicle],
    zones: Sequence[ConflictZone | None],
    front: float,
    speed: float,
    asked: PriorityGap,
) -> list[Blocker]:
    """The vehicles that block the ego now, in the order of `vehicles`.

    zones: by path of the vehicles, with the ego's path (a: ego, b: other), as `path_zones` has them for that path.
    front: the ego's on its path, < 0 before the line. speed: the ego's.
    """
    found = (blocker(v, zones[v.path], front, speed, asked) for v in vehicles)
    return [one for one in found if one is not None]
