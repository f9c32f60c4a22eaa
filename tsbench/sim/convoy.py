"""The release of a convoy, or of pedestrians: once, when the first would meet the ego in the conflict zone.

Source: docs/scenes.md, "Priority at junctions". The prediction reads the ego's present place and speed
only; planners never see the plan.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from tsbench.roads.network import Lane, RoadNetwork
from tsbench.sim.scene import ReleasePlan, WalkersPlan
from tsbench.sim.world import EGO_LENGTH_M, EgoState

RELEASE_AT_M = 12.0
# Pedestrians wait no longer for an ego that is so near.
WALKERS_AT_M = 3.0
# What the plates say is shown to an ego that waits within so many metres of its line, or is under way and could no
# longer stop with this deceleration before the zone in which it meets others.
SHOWS_AT_M = 5.0
LATE_BRAKE_MPS2 = 6.0
# So slow is an ego that waits at a junction.
WAITS_MPS = 1.0
# At a crossing, where nobody has to wait, one that is slower than is allowed where no plate asks for it: this share of
# what its road allows, less this difference (lowest_speed_ratio x cruise_ratio and least_difference_mps of
# sign_catalog/rules/needless.yaml).
LOWEST_SHARE, LEAST_DIFFERENCE_MPS = 0.35, 0.5
_ACCEL_MPS2 = 1.5
_BRAKE_MPS2 = 2.0
_STEP_S = 0.2
_LONG_S = 60.0
# A convoy can be at its own line no later than that after the ego can be in the zone.
REACHED_AFTER_S = 1.0
# For an ego that slows down it slows down too: it is at its line so much later than the ego is expected in the zone.
# So it still comes, and does not stand there, when a slow ego decides.
KEEPS_BACK_S = 1.5
NEAR_M = 30.0


def predicted_arrival(to_line: float, to_zone: float, speed: float, cruise: float, turn: float) -> float:
    """Seconds until the ego's front has gone `to_zone` metres, at most 60.

    It accelerates to `cruise` and is down at `turn` (m/s) when it reaches the line, `to_line` metres ahead.
    """
    gone, time, v = 0.0, 0.0, speed
    while gone < to_zone and time < _LONG_S:
        room = max(to_line - gone, 0.0)
        cap = (turn * turn + 2.0 * _BRAKE_MPS2 * room) ** 0.5
        v = min(v + _ACCEL_MPS2 * _STEP_S, cruise, max(cap, 0.5))
        gone += v * _STEP_S
        time += _STEP_S
    return time - (gone - to_zone) / max(v, 0.5)


def earliest_arrival(way: float, speed: float, accel: float, top: float) -> float:
    """Least seconds in which a vehicle goes `way` metres from `speed` (m/s), with `accel` (m/s2) up to `top` (m/s)."""
    speeding_m = max(top**2 - speed**2, 0.0) / (2.0 * accel)
    if way <= speeding_m:
        return (math.sqrt(speed**2 + 2.0 * accel * max(way, 0.0)) - speed) / accel
    return max(top - speed, 0.0) / accel + (way - speeding_m) / max(top, speed)


@dataclass(frozen=True, slots=True)
class Showing:
    """When others may show an ego what the plates say: only where that comes too late to go by it.

    zone_m: from the ego's line to the zone in which it meets them. waits_mps: slower than this it waits, which is
    needless in the half in which nobody has to.
    """

    zone_m: float = 0.0
    waits_mps: float = WAITS_MPS

    @classmethod
    def of(cls, plan: ReleasePlan | None) -> Showing:
        """As of a convoy or of pedestrians; None: no road user is held for the ego."""
        if plan is None:
            return cls()
        if isinstance(plan, WalkersPlan):
            return cls(plan.ego_zone_m, LOWEST_SHARE * plan.ego_cruise_mps - LEAST_DIFFERENCE_MPS)
        return cls(plan.ego_zone_m)

    def may(self, to_line: float, speed: float) -> bool:
        """May they by now? to_line: metres from the ego's front to its line."""
        waits = to_line <= SHOWS_AT_M and speed < self.waits_mps
        return waits or to_line + self.zone_m <= speed * speed / (2.0 * LATE_BRAKE_MPS2)


class Approach:
    """The ego's station on its way to the line at the end of a lane: from geometry alone, whatever lane it is on."""

    def __init__(self, lane: Lane) -> None:
        self._line = lane.line
        self._length = lane.line.length
        x, y = lane.line.point_at(self._length)
        heading = lane.line.heading_at(self._length)
        self._end = x, y, math.cos(heading), math.sin(heading)
        x, y = lane.line.point_at(0.0)
        heading = lane.line.heading_at(0.0)
        self._start = x, y, math.cos(heading), math.sin(heading)

    def to_line(self, ego: EgoState) -> float:
        """Metres from the ego's front to the line along the lane, < 0 past it; both ends go on straight."""
        half = EGO_LENGTH_M / 2
        s, _ = self._line.project(ego.x, ego.y)
        if s >= self._length:
            x, y, cos, sin = self._end
            return (x - ego.x) * cos + (y - ego.y) * sin - half
        if s <= 0.0:
            x, y, cos, sin = self._start
            s = (ego.x - x) * cos + (ego.y - y) * sin
        return self._length - s - half


class ConvoyRelease:
    """Decides the moment of release, of vehicles or pedestrians. `update` returns True once, at that tick."""

    def __init__(self, plan: ReleasePlan, network: RoadNetwork) -> None:
        self.plan = plan
        lane = network.lane(plan.line_lane)
        self.approach = Approach(lane)
        self._walkers = isinstance(plan, WalkersPlan)
        self._latest_m = WALKERS_AT_M if self._walkers else RELEASE_AT_M
        self.showing = Showing.of(plan)
        self._until_past = isinstance(plan, WalkersPlan) and plan.until_past
        ways = [sum(network.lanes[v].line.length for v in c.via) for c in network.outgoing[lane.index]]
        self._through_m = max(ways, default=0.0)
        self._done = False

    def update(self, ego: EgoState) -> bool:
        """Is it time, and was it not before?"""
        return not self._done and self.update_at(self.approach.to_line(ego), ego.speed)

    def update_at(self, to_line: float, speed: float) -> bool:
        """The same from the ego's station: its front's metres to the line."""
        if self._done:
            return False
        self._done = self._is_time(to_line, speed)
        return self._done

    def _is_time(self, to_line: float, speed: float) -> bool:
        if self._until_past:
            # The ego's centre is behind the junction that the line leads into.
            return -to_line - EGO_LENGTH_M / 2 > self._through_m
        if self._walkers and not self.showing.may(to_line, speed):
            return False
        if to_line <= self._latest_m:
            return True
        plan = self.plan
        eta = predicted_arrival(to_line, to_line + plan.ego_zone_m, speed, plan.ego_cruise_mps, plan.ego_turn_mps)
        return eta <= plan.ahead_s
