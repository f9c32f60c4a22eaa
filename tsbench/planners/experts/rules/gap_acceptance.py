"""Giving way at a junction: come so that there is room to stop, wait until the way is free, then go.

`RightOfWay` does so, as the network has it, at the other junctions on the way, where no sign of the scene speaks: the
way round a prohibited turn leads over several, which the ego has to pass unhurt. Units: m, s, m/s, m/s2.
"""

from __future__ import annotations

import math
from collections.abc import Set as AbstractSet
from dataclasses import dataclass

from tsbench.geometry.overlap import ConflictZone
from tsbench.planners.base import Privilege
from tsbench.planners.experts.rules.conflict_check import (
    CrossingPlan,
    GapRequirement,
    ObservedVehicle,
    WayThrough,
    crossing,
    paths_through,
)
from tsbench.planners.experts.rules.constraint import FREE, slow_to
from tsbench.planners.geometry import HALF_LENGTH_M, PathSamples, first_contact, moving_ahead, speed_at, speed_profile
from tsbench.planners.idm import IdmParameters, free_road
from tsbench.planners.observation import Observation, true_world
from tsbench.roads.junction_paths import JunctionPath
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.planner_map import PlannerMap
from tsbench.roads.priority import EXPERT_FOLLOWING, PriorityVehicles
from tsbench.sim.navigation import RouteView
from tsbench.sim.world import DT_S


@dataclass(frozen=True, slots=True)
class YieldParams:
    """How the ego itself comes and goes.

    hold_m: room left between the waiting front and the line. brake: with which it comes to a stop. stands: speed
    below which a vehicle stands. near_m: with the front this near to the line, others have seen the ego come.
    room_m: needed behind the last zone. Within the junction: rolls, the least speed that is reckoned with;
    clear_m, left before a zone; into_m, by which it may reach in where it stops too late; apart_s, between the one
    and the other in it.
    """

    hold_m: float = 1.0
    brake: float = 2.2
    stands: float = 0.5
    near_m: float = 11.0
    room_m: float = 2.0
    rolls: float = 1.5
    clear_m: float = 0.5
    into_m: float = 0.3
    apart_s: float = 0.5


# No rule of the scene speaks for these: others see who is in the junction, and slow down a little.
COURTESY = GapRequirement(
    gap=0.0, least=2.0, post_clear=0.0, gap_s=0.0, clear_s=0.0, foe_accel=1.6, patience_s=2.0, trust=0.1, share=0.4
)
# How the ego itself will go: the brisk end of what a base planner does is not counted on.
_GO = IdmParameters(accel=2.4, lateral=2.8)
_EGO = IdmParameters(accel=2.3, lateral=2.6)
_MANNER = YieldParams()
_NEAR_M = 8.0
_LONGEST_S = 15.0
_LOOK_M = 90.0
_COMMIT_MPS2 = 4.0
_HARDEST_MPS2 = 5.0


class Yielding:
    """One junction, from one approach (SUMO's edge): stops before its line while a vehicle is in the way.

    paths: those that have priority by a rule, which asks `demand` of the ego. others: further paths through the
    junction; on these, vehicles with the network's right of way over the ego, or in the junction already, are let
    pass as `courtesy` asks.
    """

    def __init__(
        self,
        privilege: Privilege,
        approach: str,
        paths: tuple[JunctionPath, ...],
        demand: GapRequirement,
        others: tuple[JunctionPath, ...] = (),
        courtesy: GapRequirement = COURTESY,
    ) -> None:
        self._privilege, self._approach = privilege, approach
        self._paths, self._ruled = (*paths, *others), len(paths)
        self._demand, self._courtesy = demand, courtesy
        self._finder = PriorityVehicles(privilege.network, self._paths, EXPERT_FOLLOWING)
        self._path: RoutePath | None = None
        self._passage: WayThrough | None = None
        self._samples: PathSamples
        self._speeds: list[float]
        self._standing: dict[int, float] = {}
        self._trend: dict[int, tuple[float, float]] = {}
        self._committed = False

    def to_line(self, route: RouteView) -> float | None:
        """Metres from the ego's front to the line along a route; None where the route does not cross it (any more)."""
        if route.path is not self._path:
            self._prepare(route.path)
        return None if self._passage is None else self._passage.line_s - route.s - HALF_LENGTH_M

    def passed(self, route: RouteView) -> bool:
        """Has the ego's rear left the last zone, or does its route not come here (any more)?"""
        to_go, here = self.to_line(route), self._passage
        return to_go is None or here is None or route.s - HALF_LENGTH_M > here.end_s

    def acceleration_bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        """While a vehicle blocks: what still stops before the line. In the junction: not slower than need be."""
        to_go, here = self.to_line(route), self._passage
        if to_go is None or here is None or to_go > _LOOK_M or self.passed(route):
            return FREE
        v = observation.ego.speed
        if to_go < 0.0:
            self._committed = True
        self._note_standing(observation, to_go)
        if not self._committed:
            if not self._free(observation, route, here):
                return -math.inf, slow_to(v, 0.0, to_go - _MANNER.hold_m, _MANNER.brake)
            # Beyond this point braking would end past the line.
            self._committed = v * v / (2.0 * _COMMIT_MPS2) >= to_go - 0.2
        most = self._defensively(observation, route, here) if self._committed else math.inf
        return (self._briskly(observation, route, here) if to_go < _NEAR_M else -math.inf), most

    def _defensively(self, observation: Observation, route: RouteView, here: WayThrough) -> float:
        """Stops before the zone of a vehicle that drives through the junction and will not let the ego go first."""
        most, v = math.inf, observation.ego.speed
        front = route.s + HALF_LENGTH_M - here.line_s
        for vehicle in self._finder.find(true_world(observation).actors):
            zone = here.zones[vehicle.path]
            if zone is None or vehicle.s <= 0.0 or vehicle.s - vehicle.length > zone.b_out:
                continue
            if observation.time - self._standing.get(vehicle.row, observation.time) > COURTESY.patience_s:
                continue
            room = zone.a_in - front
            if v * v > 2.0 * _HARDEST_MPS2 * (room + _MANNER.into_m):
                continue  # too late to stop: the sooner the ego is through the better
            first, last = self._ends(here, zone)
            enters, left = self._times(route.s, v, [first, last])
            speed = max(vehicle.speed, _MANNER.rolls)
            there, gone = (zone.b_in - vehicle.s) / speed, (zone.b_out + vehicle.length - vehicle.s) / speed
            if there < left + _MANNER.apart_s and enters < gone + _MANNER.apart_s:
                most = min(most, slow_to(v, 0.0, room - _MANNER.clear_m, _MANNER.brake))
        return most

    def _briskly(self, observation: Observation, route: RouteView, here: WayThrough) -> float:
        """The acceleration of a driver that was given the gap, unless a vehicle is in front."""
        v = observation.ego.speed
        reach = here.end_s - route.s + 2.0 * HALF_LENGTH_M + v * v / 4.0
        if moving_ahead(self._samples, route.s, reach, observation.actors):
            return -math.inf
        return free_road(v, speed_at(self._speeds, route.s + 0.5 * v), _GO)

    def _prepare(self, path: RoutePath) -> None:
        self._path = path
        self._passage = crossing(self._privilege, path, self._approach, self._paths, self._ruled)
        self._samples = PathSamples(path)
        self._speeds = speed_profile(path, self._samples, lateral=_EGO.lateral, decel=2.0, factor=1.0, top=math.inf)

    def _note_standing(self, observation: Observation, to_go: float) -> None:
        """Since when have others been standing with the ego in sight at the line?"""
        actors, standing = true_world(observation).actors, self._standing
        for row, speed in zip(actors.index.tolist(), actors.speed.tolist(), strict=True):
            if speed > _MANNER.stands or to_go > _MANNER.near_m:
                standing.pop(row, None)
            else:
                standing.setdefault(row, observation.time)

    def _free(self, observation: Observation, route: RouteView, here: WayThrough) -> bool:
        """May the ego go on now, if it goes on as it would?"""
        vehicles = self._finder.find(true_world(observation).actors)
        # Smoothed acceleration of each vehicle with priority, from tick to tick.
        for one in vehicles:
            speed, accel = self._trend.get(one.row, (one.speed, 0.0))
            self._trend[one.row] = (one.speed, accel + 0.3 * ((one.speed - speed) / DT_S - accel))
        # A vehicle without right of way counts too, once it is in the junction.
        coming = [
            (f, z)
            for f in vehicles
            if (z := here.zones[f.path]) is not None
            and f.s - f.length <= z.b_out
            and (f.path in here.first or f.s > 0.0)
        ]
        if not coming:
            return self._room_behind(observation, here)
        # The centre's place when the front is at the line, at each zone, and when the rear has left it.
        line = here.line_s - HALF_LENGTH_M
        marks = sorted({line, *(m for _, z in coming for m in self._ends(here, z))})
        times = dict(zip(marks, self._times(route.s, observation.ego.speed, marks), strict=True))
        for vehicle, zone in coming:
            first, last = self._ends(here, zone)
            plan = CrossingPlan(times[line], times[first], times[last])
            standing = observation.time - self._standing.get(vehicle.row, observation.time)
            seen = ObservedVehicle(vehicle, self._paths[vehicle.path], zone, self._trend[vehicle.row][1], standing)
            demand = self._demand if vehicle.path < self._ruled else self._courtesy
            if demand.blocks(seen, plan):
                return False
        return self._room_behind(observation, here)

    def _ends(self, here: WayThrough, zone: ConflictZone) -> tuple[float, float]:
        """Places of the ego's centre on its route when its front enters a zone and when its rear has left it."""
        return here.line_s + zone.a_in - HALF_LENGTH_M, here.line_s + zone.a_out + HALF_LENGTH_M

    def _room_behind(self, observation: Observation, here: WayThrough) -> bool:
        """Can the ego leave the junction, or does a vehicle stand in or just behind it?"""
        actors, samples = observation.actors, self._samples
        first = max(math.ceil(here.line_s), 0)
        last = min(int(here.end_s + 2.0 * HALF_LENGTH_M + _MANNER.room_m), samples.last)
        lengths, widths, speeds = actors.length.tolist(), actors.width.tolist(), actors.speed.tolist()
        for k, (x, y, heading) in enumerate(actors.pose.tolist()):
            # Crossing vehicles will be gone.
            if speeds[k] < 1.0 and first_contact(samples, first, last, (x, y, heading, lengths[k], widths[k])) >= 0:
                return False
        return True

    def _times(self, s: float, v: float, marks: list[float]) -> list[float]:
        """Seconds until the ego's centre is at each of `marks` (arc lengths, ascending) if it goes on freely."""
        times: list[float] = []
        time, step = 0.0, 2.0 * DT_S
        while len(times) < len(marks) and time < _LONGEST_S:
            while len(times) < len(marks) and s >= marks[len(times)]:
                times.append(time)
            faster = max(v + step * free_road(v, speed_at(self._speeds, s + 0.5 * v), _EGO), 0.3)
            s += 0.5 * (v + faster) * step
            v = faster
            time += step
        return times + [_LONGEST_S] * (len(marks) - len(times))


# SUMO's states of a connection that gives way: "m", or "s" after a stop.
_MINOR = "ms"
_WITHIN_M = 60.0


class RightOfWay:
    """Bounds the acceleration before each such junction; `but`: approaches (on the map) that constraints look after.

    alert_edges: those at whose end the ego has right of way, and looks out all the same for vehicles in the junction.
    demand: what is asked before the ego goes in front of a vehicle with right of way.
    """

    def __init__(
        self,
        privilege: Privilege,
        but: AbstractSet[str] = frozenset(),
        alert_edges: AbstractSet[str] = frozenset(),
        demand: GapRequirement = COURTESY,
    ) -> None:
        self._privilege, self._but, self._alert = privilege, but, alert_edges
        self._demand = demand
        self._path: RoutePath | None = None
        self._junctions: list[tuple[float, str]] = []
        self._near: list[Yielding] = []

    def acceleration_bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        """What the junctions ahead ask for, each until the ego has left it."""
        if route.path is not self._path:
            self._path, self._near = route.path, []
            self._junctions = _minor(self._privilege.view, route.path, self._but, self._alert)
            while self._junctions and self._junctions[0][0] < route.s:
                del self._junctions[0]
        while self._junctions and self._junctions[0][0] - route.s <= _WITHIN_M:
            _, approach = self._junctions.pop(0)
            others = paths_through(self._privilege.network, approach)
            self._near.append(Yielding(self._privilege, approach, (), self._demand, others, self._demand))
        if not self._near:
            return FREE
        asked = [junction.acceleration_bounds(observation, route) for junction in self._near]
        self._near = [junction for junction in self._near if not junction.passed(route)]
        return max(least for least, _ in asked), min(most for _, most in asked)


def _minor(
    view: PlannerMap, path: RoutePath, but: AbstractSet[str], alert_edges: AbstractSet[str]
) -> list[tuple[float, str]]:
    """The junctions of a path where its connection gives way, and those at the end of `alert_edges` edges, in order.

    Of each the arc length of its line, and its approach (SUMO's edge).
    """
    found = []
    for piece, after in zip(path.pieces, path.pieces[1:], strict=False):
        lane, link = view.map.lanes[piece.lane], view.crossed.get(after.lane)
        if link is None or lane.edge in but or (link.state not in _MINOR and lane.edge not in alert_edges):
            continue
        found.append((piece.s1, view.chains[lane.edge][-1]))
    return found
