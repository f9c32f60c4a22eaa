"""Giving way at a junction: come so that there is room to stop, wait until the way is free, then go.

Units: m, s, m/s, m/s2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from tsbench.geometry.overlap import ConflictZone
from tsbench.maps.network import RoadNetwork
from tsbench.planners.ahead import HALF_LENGTH_M, moving_ahead
from tsbench.planners.base import Observation
from tsbench.planners.guards.base import FREE, slow_to
from tsbench.planners.guards.junction import Foe, FoeFinder, Passage, Way, passage
from tsbench.planners.idm import IdmParameters, free_road
from tsbench.planners.profile import PathSamples, speed_at, speed_profile
from tsbench.sim.lanegraph import RoutePath
from tsbench.sim.navigation import RouteView
from tsbench.sim.world import DT_S


@dataclass(frozen=True, slots=True)
class Plan:
    """Seconds until the ego's front is at the line, until it enters a zone, until its rear has left that."""

    at_line: float
    enters: float
    left: float


@dataclass(frozen=True, slots=True)
class Caution:
    """How much more than the rule an expert asks for.

    hold_m: room left between the waiting front and the line. brake: with which it comes to a stop.
    gap_s, clear_s: on top of the rule's own. behind_s: after one who has just cleared the zone.
    foe_accel: with which others may gather speed; `trust` on top of what is seen, if they are not `slow` (m/s).
    stands: speed below which a vehicle stands. near_m: with the front this near to the line, others have seen
    the ego come. patience_s: after which one who stands all the while is taken to go on standing.
    room_m: needed behind the last zone. share: how much of its way through the ego has done when the other comes.
    """

    hold_m: float = 1.0
    brake: float = 2.2
    gap_s: float = 0.2
    clear_s: float = 0.4
    behind_s: float = 0.1
    foe_accel: float = 2.2
    trust: float = 0.2
    slow: float = 3.0
    stands: float = 0.3
    near_m: float = 11.0
    patience_s: float = 5.0
    room_m: float = 2.0
    share: float = 1.0


# How the ego itself will go: the brisk end of what a base planner does is not counted on.
_GO = IdmParameters(accel=2.4, lateral=2.8)
_EGO = IdmParameters(accel=2.3, lateral=2.6)
_NEAR_M = 8.0
_FOE_BRAKE_MPS2 = 3.5
_STEP_M = 2.0
_LONGEST_S = 15.0
_LOOK_M = 90.0
_COMMIT_MPS2 = 4.0


class Yielding:
    """One junction, from one approach: stops before its line while others with priority are in the way.

    gap: a vehicle that would reach its zone within so many seconds is in the way, its speed counted as `least` at
    least; 0: no rule says so. post_clear: seconds for which the ego has left a zone before the next one is there.
    """

    def __init__(
        self,
        network: RoadNetwork,
        approach: str,
        ways: tuple[Way, ...],
        *,
        gap: float,
        least: float,
        post_clear: float,
        caution: Caution | None = None,
    ) -> None:
        self._network, self._approach, self._ways = network, approach, ways
        self._finder = FoeFinder(network, ways)
        self._gap, self._least, self._post_clear = gap, least, post_clear
        self._caution = caution or Caution()
        self._path: RoutePath | None = None
        self._passage: Passage | None = None
        self._samples: PathSamples
        self._speeds: list[float]
        self._standing: dict[int, float] = {}
        self._trend: dict[int, tuple[float, float]] = {}
        self._committed = False

    def bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        """While somebody blocks: what still stops before the line. In the junction: not slower than need be."""
        if route.path is not self._path:
            self._prepare(route.path)
        here = self._passage
        if here is None or route.s - HALF_LENGTH_M > here.end_s:
            return FREE
        v, to_go = observation.ego.speed, here.line_s - route.s - HALF_LENGTH_M
        if to_go > _LOOK_M:
            return FREE
        if to_go < 0.0:
            self._committed = True
        if not self._committed:
            self._note_standing(observation, to_go)
            if not self._free(observation, route, here):
                return -math.inf, slow_to(v, 0.0, to_go - self._caution.hold_m, self._caution.brake)
            # Beyond this point braking would end past the line.
            self._committed = v * v / (2.0 * _COMMIT_MPS2) >= to_go - 0.2
        return (self._briskly(observation, route, here) if to_go < _NEAR_M else -math.inf), math.inf

    def _briskly(self, observation: Observation, route: RouteView, here: Passage) -> float:
        """The acceleration with which a driver goes who was given the gap, unless somebody is in front."""
        v = observation.ego.speed
        reach = here.end_s - route.s + 2.0 * HALF_LENGTH_M + v * v / 4.0
        if moving_ahead(self._samples, route.s, reach, observation.actors):
            return -math.inf
        return free_road(v, speed_at(self._speeds, route.s + 0.5 * v), _GO)

    def _prepare(self, path: RoutePath) -> None:
        self._path = path
        self._passage = passage(self._network, path, self._approach, self._ways)
        self._samples = PathSamples(path)
        self._speeds = speed_profile(
            path, self._samples, lateral=_EGO.lateral, decel=2.0, factor=1.0, top=math.inf
        )

    def _note_standing(self, observation: Observation, to_go: float) -> None:
        """Since when have others been standing with the ego in sight at the line?"""
        actors, standing = observation.actors, self._standing
        for row, speed in zip(actors.index.tolist(), actors.speed.tolist(), strict=True):
            if speed > self._caution.stands or to_go > self._caution.near_m:
                standing.pop(row, None)
            else:
                standing.setdefault(row, observation.time)

    def _free(self, observation: Observation, route: RouteView, here: Passage) -> bool:
        """May the ego go on now, if it goes on as it would?"""
        foes = self._finder.find(observation.actors)
        self._note_trend(foes)
        coming = [(f, z) for f in foes if (z := here.zones[f.way]) is not None and f.s - f.length <= z.b_out]
        if not coming:
            return self._room_behind(observation, route, here)
        # The centre's place when the front is at the line, at each zone, and when the rear has left it.
        line = here.line_s - HALF_LENGTH_M
        marks = sorted({line, *(m for _, z in coming for m in self._ends(here, z))})
        times = dict(zip(marks, self._times(route.s, observation.ego.speed, marks), strict=True))
        for foe, zone in coming:
            first, last = self._ends(here, zone)
            plan = Plan(times[line], times[first], times[last])
            if self._blocks(foe, zone, plan, observation.time):
                return False
        return self._room_behind(observation, route, here)

    def _ends(self, here: Passage, zone: ConflictZone) -> tuple[float, float]:
        """Places of the ego's centre on its route when its front enters a zone and when its rear has left it."""
        return here.line_s + zone.a_in - HALF_LENGTH_M, here.line_s + zone.a_out + HALF_LENGTH_M

    def _blocks(self, foe: Foe, zone: ConflictZone, plan: Plan, now: float) -> bool:
        """Would the rule, or a careful driver, say that this vehicle is in the way?"""
        at_line = plan.at_line
        to_zone, c = zone.b_in - foe.s, self._caution
        to_clear = zone.b_out + foe.length - foe.s
        if foe.speed > 1.0 and to_clear / (0.9 * foe.speed) < at_line - c.behind_s:
            # Gone before the ego is at the line; should it stop, there is still room to stop as well.
            return False
        if foe.speed > c.slow and to_clear / (0.8 * foe.speed) < plan.enters - c.behind_s and not self._gap:
            return False  # through before the ego gets there, even if it dawdles
        if to_zone <= 0.0:
            return True
        if not self._gap:
            return self._too_soon(foe, to_zone, plan)
        # It may keep its speed or gather more; which of the two is worse differs by clause.
        kept = to_zone - foe.speed * at_line
        gone, speed = gather(foe.speed, self._limit(foe), self._gathers(foe), at_line)
        gap = self._gap + c.gap_s
        if min(kept, to_zone - gone) <= 0.0:
            return True
        patient = now - self._standing.get(foe.row, now) > c.patience_s
        if patient:
            return to_zone / self._least < gap + at_line
        if kept / max(foe.speed, self._least) < gap or (to_zone - gone) / max(speed, self._least) < gap:
            return True
        if foe.speed > c.slow and to_clear / (0.8 * foe.speed) < plan.enters - c.behind_s:
            return False  # through before the ego gets there, even if it dawdles
        return self._too_soon(foe, to_zone, plan)

    def _too_soon(self, foe: Foe, to_zone: float, plan: Plan) -> bool:
        """Would it be there before the ego has gone its share of the way through?"""
        c = self._caution
        through = plan.enters + c.share * (plan.left - plan.enters)
        return self._soonest(foe, to_zone) < through + self._post_clear + c.clear_s

    def _gathers(self, foe: Foe) -> float:
        """With which acceleration it is reckoned: one who drives steadily is trusted to go on so, nearly."""
        c = self._caution
        if foe.speed < c.slow:
            return c.foe_accel
        seen = self._trend[foe.row][1]
        return min(max(seen, 0.0) + c.trust, c.foe_accel)

    def _note_trend(self, foes: list[Foe]) -> None:
        """Smoothed acceleration of each vehicle with priority, from tick to tick."""
        for foe in foes:
            speed, accel = self._trend.get(foe.row, (foe.speed, 0.0))
            self._trend[foe.row] = (foe.speed, accel + 0.3 * ((foe.speed - speed) / DT_S - accel))

    def _limit(self, foe: Foe) -> float:
        return max(foe.speed, self._ways[foe.way].source.speed)

    def _soonest(self, foe: Foe, way: float) -> float:
        """Least seconds until a vehicle has gone `way` metres: it gathers speed, but slows down for its turn."""
        turn, limit, accel = self._ways[foe.way].inner[0].speed, self._limit(foe), self._gathers(foe)
        gone, time, v = 0.0, 0.0, foe.speed
        while gone < way:
            cap = math.sqrt(turn * turn + 2.0 * _FOE_BRAKE_MPS2 * max(-foe.s - gone, 0.0))
            faster = min(math.sqrt(v * v + 2.0 * accel * _STEP_M), limit, max(cap, 1.0))
            time += 2.0 * _STEP_M / (v + faster)
            gone, v = gone + _STEP_M, faster
        return time - (gone - way) / v

    def _room_behind(self, observation: Observation, route: RouteView, here: Passage) -> bool:
        """Can the ego leave the junction, or does somebody stand in or just behind it?"""
        reach = here.end_s + 2.0 * HALF_LENGTH_M + self._caution.room_m - route.s - HALF_LENGTH_M
        ahead = moving_ahead(self._samples, route.s, reach, observation.actors)
        return not any(end > here.line_s and speed < 1.0 for end, speed in ahead)

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


def gather(v: float, limit: float, accel: float, time: float) -> tuple[float, float]:
    """Way (m) and speed after `time` of a vehicle that accelerates up to its limit."""
    ramp = min(max(limit - v, 0.0) / accel, time)
    end = v + accel * ramp
    return 0.5 * (v + end) * ramp + end * (time - ramp), end
