"""A junction as an expert sees it: the way through, who goes first, and who is in the way of an ego about to cross.

In the way is another vehicle by the rule, or by a careful driver's measure. Units: m, s, m/s, m/s2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from tsbench.geometry.overlap import ConflictZone
from tsbench.planners.base import Privilege
from tsbench.roads.junction_paths import JunctionPath, junction_path, junction_paths, path_zones
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.network import RoadNetwork
from tsbench.roads.priority import PriorityVehicle

# As wide as bodies with some room.
_BODY_M = 2.4


@dataclass(frozen=True, slots=True)
class WayThrough:
    """The ego's own way through: arc length of its line on its route, zone with each path of the others.

    first: the paths whose vehicles go before the ego, by a plate or by the network's right of way.
    """

    line_s: float
    zones: tuple[ConflictZone | None, ...]
    first: frozenset[int]

    @property
    def end_s(self) -> float:
        """Arc length on the route where the last zone ends."""
        return self.line_s + max((z.a_out for z in self.zones if z is not None), default=0.0)


def paths_through(network: RoadNetwork, approach: str, but: tuple[str, ...] = ()) -> tuple[JunctionPath, ...]:
    """The paths through the junction at the end of `approach` from its other approaches, save some."""
    junction, left_out = network.edges[approach].target, {approach, *but}
    edges = (e.id for e in network.edges.values() if e.target == junction and not e.internal)
    return junction_paths(network, (e for e in edges if e not in left_out))


def crossing(
    privilege: Privilege, path: RoutePath, approach: str, others: tuple[JunctionPath, ...], ruled: int = 0
) -> WayThrough | None:
    """Where a route passes the junction from `approach` (SUMO's edge); None where it does not (any more).

    ruled: so many of the others' paths, the first ones, have priority by a plate: there strips are as wide as their
    lanes, as the rule has them, else as wide as bodies with some room. However little they overlap, they conflict:
    an expert is careful already where the rule sees no zone yet.
    """
    network, view = privilege.network, privilege.view
    edge, lanes = view.on_edge(approach)[0], view.map.lanes
    on_it = [lanes[piece.lane].edge == edge for piece in path.pieces] + [False]
    if True not in on_it:
        return None
    at = on_it.index(False, on_it.index(True)) - 1
    if at + 1 == len(path.pieces) or path.pieces[at + 1].lane not in view.crossed:
        return None
    taken = junction_path(network, view.crossed[path.pieces[at + 1].lane])
    by_plate = path_zones((taken,), others[:ruled])[0]
    by_body = path_zones((taken,), others[ruled:], width=_BODY_M)[0]
    prior = taken.connection.yields_to
    return WayThrough(
        line_s=path.pieces[at].s1,
        zones=(*by_plate, *by_body),
        first=frozenset(k for k, other in enumerate(others) if k < ruled or not prior.isdisjoint(other.connection.via)),
    )


_BRAKE_MPS2 = 3.5
_STEP_M = 2.0
_BRAKES_MPS2 = -0.3
_WALK_MPS = 1.5


@dataclass(frozen=True, slots=True)
class CrossingPlan:
    """Seconds until the ego's front is at the line, until it enters a zone, until its rear has left that."""

    at_line: float
    enters: float
    left: float


@dataclass(frozen=True, slots=True)
class ObservedVehicle:
    """A vehicle as the ego sees it: where it is, its path and zone, its own acceleration lately, standing for how long.

    `standing` counts from when the ego could be seen at the line.
    """

    vehicle: PriorityVehicle
    path: JunctionPath
    zone: ConflictZone
    accel: float
    standing: float

    @property
    def to_zone(self) -> float:
        """From its front to the zone; < 0 in it."""
        return self.zone.b_in - self.vehicle.s

    @property
    def to_clear(self) -> float:
        """Until its rear has left the zone."""
        return self.zone.b_out + self.vehicle.length - self.vehicle.s

    def through_by(self, time: float, share: float) -> bool:
        """Has it left the zone by then, driving at a share of its present speed?"""
        return self.vehicle.speed > 1.0 and self.to_clear / (share * self.vehicle.speed) < time


@dataclass(frozen=True, slots=True)
class GapRequirement:
    """What is asked before the ego goes in front of another vehicle.

    gap: a vehicle that would reach its zone within so many seconds of the ego's entry there is in the way, its speed
    counted as `least` at least; 0: no rule says so. post_clear: for so long the ego has left a zone before the next
    one is there. On top of these: gap_s, clear_s. behind_s: after a vehicle that has just cleared the zone. foe_accel:
    assumed acceleration of others; `trust` on top of what is seen, if they are not `slow` (m/s). patience_s: a vehicle
    that has stood for so long is taken to go on standing. share: how much of its way through the zone the ego has
    done when a vehicle comes that is still before its line; all of it where the other is in the junction.
    """

    gap: float
    least: float
    post_clear: float
    gap_s: float = 0.2
    clear_s: float = 0.4
    behind_s: float = 0.1
    foe_accel: float = 2.2
    trust: float = 0.2
    slow: float = 3.0
    patience_s: float = 5.0
    share: float = 1.0

    def blocks(self, seen: ObservedVehicle, plan: CrossingPlan) -> bool:
        """Would the rule, or a careful driver, say that this vehicle is in the way?"""
        if seen.through_by(plan.at_line - self.behind_s, 0.9):
            return False  # should the ego stop at the line, there is still room to stop as well
        dawdles = seen.vehicle.speed > self.slow and seen.through_by(plan.enters - self.behind_s, 0.8)
        if not self.gap:
            return not dawdles and self._in_the_way(seen, plan)
        if seen.to_zone <= 0.0:
            return True
        blocked = self._within_gap(seen, plan)
        if blocked or seen.standing > self.patience_s:
            return blocked
        return not dawdles and self._too_soon(seen, plan)

    def _in_the_way(self, seen: ObservedVehicle, plan: CrossingPlan) -> bool:
        """Where no gap is asked for."""
        return seen.standing <= self.patience_s and (seen.to_zone <= 0.0 or self._too_soon(seen, plan))

    def _within_gap(self, seen: ObservedVehicle, plan: CrossingPlan) -> bool:
        """It may keep its speed or gather more until the ego enters the zone, where the rule counts the gap."""
        vehicle, enters, gap = seen.vehicle, plan.enters, self.gap + self.gap_s
        if seen.standing > self.patience_s:
            return seen.to_zone / self.least < gap + enters
        kept = seen.to_zone - vehicle.speed * enters
        gone, speed = gather(vehicle.speed, self._limit(seen), self._gathers(seen), enters)
        left = seen.to_zone - gone
        return kept / max(vehicle.speed, self.least) < gap or left / max(speed, self.least) < gap

    def _too_soon(self, seen: ObservedVehicle, plan: CrossingPlan) -> bool:
        """Would it be there before the ego has gone its share of the way through?"""
        share = self.share if seen.vehicle.s < 0.0 else 1.0
        through = plan.enters + share * (plan.left - plan.enters)
        return self._soonest(seen) < through + self.post_clear + self.clear_s

    def _gathers(self, seen: ObservedVehicle) -> float:
        """Its assumed acceleration: a vehicle that drives steadily is trusted to go on so, nearly."""
        if seen.vehicle.speed < self.slow:
            return self.foe_accel
        return min(max(seen.accel, 0.0) + self.trust, self.foe_accel)

    @staticmethod
    def _limit(seen: ObservedVehicle) -> float:
        return max(seen.vehicle.speed, seen.path.source.speed)

    def _soonest(self, seen: ObservedVehicle) -> float:
        """Least seconds until it reaches its zone: it gathers speed, but slows down for its turn."""
        vehicle, limit, accel = seen.vehicle, self._limit(seen), self._gathers(seen)
        # A vehicle that gives way to others, and brakes, comes to its own line at a walk.
        waits = seen.path.connection.state in "ms" and (seen.accel < _BRAKES_MPS2 or vehicle.speed < self.slow)
        turn = _WALK_MPS if waits else seen.path.inner[0].speed
        way, gone, time, v = seen.to_zone, 0.0, 0.0, vehicle.speed
        while gone < way:
            cap = math.sqrt(turn * turn + 2.0 * _BRAKE_MPS2 * max(-vehicle.s - gone, 0.0))
            faster = min(math.sqrt(v * v + 2.0 * accel * _STEP_M), limit, max(cap, 1.0))
            time += 2.0 * _STEP_M / (v + faster)
            gone, v = gone + _STEP_M, faster
        return time - (gone - way) / v


def gather(v: float, limit: float, accel: float, time: float) -> tuple[float, float]:
    """Way (m) and speed after `time` of a vehicle that accelerates up to its limit."""
    ramp = min(max(limit - v, 0.0) / accel, time)
    end = v + accel * ramp
    return 0.5 * (v + end) * ramp + end * (time - ramp), end
