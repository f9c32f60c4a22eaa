"""Drivers that read no plate and try to tell the halves of a pair apart in another way: docs/without_reading.md.

Each passes what `blind` or `idm` passes, unless its trick works. Units: m, s, m/s, m/s2.
"""
# ruff: noqa: ARG002

from __future__ import annotations

import math

import numpy as np

from tsbench import Control, Observation, PlannerContext
from tsbench.planners.floor.guess import Blind, first_fork, masked
from tsbench.planners.geometry import HALF_LENGTH_M
from tsbench.planners.idm import Idm, IdmParameters
from tsbench.planners.lane_change import LEAST_AHEAD_M
from tsbench.sim.ego import MAX_SPEED_MPS, pursue
from tsbench.sim.world import ActorKind

_BRAKE_MPS2 = 2.5
_STANDS_MPS = 0.2
_LOOK_M, _BESIDE_M = 70.0, 4.0
# Seeds that were met in this process, by any object.
_MET: set[int] = set()


class Remembers(Blind):
    """`blind` where it meets a scene for the first time, `idm` where it has met the other half."""

    # A floor is given a seed of its row, by which it could not know the other half of the pair.
    floor = False

    def reset(self, context: PlannerContext) -> None:
        super().reset(context)
        self._knows, self._plain = context.seed in _MET, Idm()
        self._plain.reset(context)
        _MET.add(context.seed)

    def act(self, observation: Observation) -> Control:
        return self._plain.act(masked(observation)) if self._knows else super().act(observation)


class _Watcher(Blind):
    """Does something that makes others act, and asks then whether they let it go first.

    watch_s: for so long. at_m: from so far before the end of the first road on.
    """

    watch_s, at_m = 12.0, math.inf

    def reset(self, context: PlannerContext) -> None:
        super().reset(context)
        self._map, self._plain, self._until, self._free = context.network, Idm(), math.inf, False
        self._plain.reset(context)

    def act(self, observation: Observation) -> Control:
        seen = masked(observation)
        # From the front to the end of the route's first road.
        to_line = first_fork(self._map, seen.route.path) - seen.route.s - HALF_LENGTH_M
        if seen.time < self._until and (to_line < self.at_m or self._until < math.inf):
            self._until = min(self._until, seen.time + self.watch_s)
            self._free = self._free or self._others_wait(seen)
            return self.watch(seen, to_line)
        return self._plain.act(seen) if self._free else super().act(observation)

    def watch(self, seen: Observation, to_line: float) -> Control:
        """What it does meanwhile."""
        raise NotImplementedError

    def _others_wait(self, seen: Observation) -> bool:
        """Does anybody on another road, or at a kerb, stand?"""
        actors, lanes, mine = seen.actors, self._map.lanes, set(seen.route.path.edges)
        near = np.hypot(actors.pose[:, 0] - seen.ego.x, actors.pose[:, 1] - seen.ego.y) < _LOOK_M
        for k in np.flatnonzero(near & (actors.speed < _STANDS_MPS)).tolist():
            lane = int(actors.lane[k])
            if actors.kind[k] == ActorKind.PEDESTRIAN or (lane >= 0 and lanes[lane].edge not in mine):
                return True
        return False


class Stands(_Watcher):
    """Brakes where it starts, stands, and watches."""

    def watch(self, seen: Observation, to_line: float) -> Control:
        return Control(-_BRAKE_MPS2, self._plain.act(seen).steering)


class Creeps(_Watcher):
    """Drives at 1.5 m/s from 40 m before the junction on, and watches."""

    watch_s, at_m = 20.0, 40.0

    def watch(self, seen: Observation, to_line: float) -> Control:
        command = self._plain.act(seen)
        return Control(min(command.acceleration, 1.0 * (1.5 - seen.ego.speed)), command.steering)


class Dips(_Watcher):
    """Swings into the oncoming lane from 55 m before the junction on, stands there behind its line, and watches."""

    at_m = 55.0

    def watch(self, seen: Observation, to_line: float) -> Control:
        ego, route = seen.ego, seen.route
        ahead = route.path.line.point_at(route.s + LEAST_AHEAD_M + 4.0, 3.0)
        slow = -(ego.speed**2) / (2.0 * max(to_line - 8.0, 0.1)) if to_line < 30.0 else 0.0
        return Control(slow, pursue(ego.x, ego.y, ego.heading, *ahead))


class Follows:
    """`idm`, and never faster than the slowest vehicle ahead of it on its way: that one may have read the plate."""

    floor = True

    def reset(self, context: PlannerContext) -> None:
        self._base = Idm()
        self._base.reset(context)

    def act(self, observation: Observation) -> Control:
        seen = masked(observation)
        command, ego, route = self._base.act(seen), seen.ego, seen.route
        speeds = [ego.speed + 9.0]
        for (x, y, _), speed in zip(seen.actors.pose.tolist(), seen.actors.speed.tolist(), strict=True):
            s, d = route.path.line.project(x, y)
            if 0.0 < s - route.s < _LOOK_M and abs(d) < _BESIDE_M and speed > _STANDS_MPS:
                speeds.append(speed)
        return Control(min(command.acceleration, min(speeds) - ego.speed), command.steering)


class Between:
    """`idm` at two thirds of what the road allows, in case one speed serves both halves."""

    floor, share = True, 0.66

    def reset(self, context: PlannerContext) -> None:
        self._base = Idm()
        self._base.reset(context)

    def act(self, observation: Observation) -> Control:
        seen = masked(observation)
        command, route = self._base.act(seen), seen.route
        return _capped(command, seen.ego.speed, self.share * route.path.limit_at(route.s))


class Rushes(Idm):
    """As fast as the car can, through bends as well: those with priority then come too late to be in its way."""

    floor, sign_access = True, False
    manner = IdmParameters(speed_factor=9.0, top_speed=MAX_SPEED_MPS, accel=30.0, decel=5.0, lateral=9.0, slowing=6.0)

    def __init__(self) -> None:
        super().__init__(self.manner)

    def act(self, observation: Observation) -> Control:
        return super().act(masked(observation))


class Hastens(Rushes):
    """No faster than the road allows, but it is there as soon as the car can, and goes through bends at 4 m/s2."""

    manner = IdmParameters(accel=30.0, lateral=4.0, slowing=4.0)


class Presses(Rushes):
    """A little above the limit, late on its brakes, and as fast as the car can from its line on."""

    manner = IdmParameters(speed_factor=9.0, top_speed=MAX_SPEED_MPS, accel=30.0, decel=3.0, lateral=4.0, slowing=3.0)
    above_mps, behind_m = 0.95, 3.0

    def reset(self, context: PlannerContext) -> None:
        super().reset(context)
        self._map = context.network

    def act(self, observation: Observation) -> Control:
        command, ego, route = super().act(observation), observation.ego, observation.route
        if first_fork(self._map, route.path) - route.s - HALF_LENGTH_M < -self.behind_m:
            return Control(self.manner.accel, command.steering)
        return _capped(command, ego.speed, route.path.limit_at(route.s) + self.above_mps)


class Brushes:
    """`idm`, but its way swings through the mouth of the other exit that is nearest to it."""

    floor, sign_access = True, False
    swing_m, inside_m, ahead_m, most_mps = 6.0, 0.5, 3.0, 3.0

    def reset(self, context: PlannerContext) -> None:
        self._base, self._map = Idm(), context.network
        self._path, self._mouth = None, None
        self._base.reset(context)

    def act(self, observation: Observation) -> Control:
        seen = masked(observation)
        command, ego, route = self._base.act(seen), seen.ego, seen.route
        if self._path is None:
            self._path, self._mouth = route.path, self._nearest_mouth(seen)
        s, d = self._mouth or (math.inf, 0.0)
        apart = (route.s + self.ahead_m - s) / self.swing_m
        if abs(apart) > 1.0 or route.path is not self._path:
            return command
        x, y = route.path.line.point_at(route.s + self.ahead_m, d * (1.0 - apart**2))
        return Control(min(command.acceleration, self.most_mps - ego.speed), pursue(ego.x, ego.y, ego.heading, x, y))

    def _nearest_mouth(self, seen: Observation) -> tuple[float, float] | None:
        """Where an exit begins that the way leaves aside: its place along the way and beside it."""
        way = seen.route.path.edges
        exits = [
            edge
            for edge in self._map.edges.values()
            if edge.source == self._map.edges[way[0]].target and edge.id not in way and not edge.internal
        ]
        points = [self._map.lanes[i].line.point_at(self.inside_m) for e in exits for i in e.lanes]
        places = [seen.route.path.line.project(*point) for point in points]
        return min(places, key=lambda place: abs(place[1]), default=None)


class Weaves:
    """`idm` as fast as the road allows, to and fro over the edge between its lane and the one beside it."""

    floor, sign_access = True, False
    period_s, share, ahead_m = 1.2, 0.5, 9.0

    def reset(self, context: PlannerContext) -> None:
        self._base, self._map = Rushes(), context.network
        self._base.reset(context)

    def act(self, observation: Observation) -> Control:
        seen = masked(observation)
        command, ego, route = self._base.act(seen), seen.ego, seen.route
        lane = self._map.lanes[route.path.lane_at(route.s)]
        side = 1.0 if lane.left >= 0 else -1.0
        if max(lane.left, lane.right) < 0:
            return command
        out = seen.time % self.period_s < self.share * self.period_s
        d = side * (lane.width / 2 + (0.7 if out else -0.7))
        ahead = route.path.line.point_at(route.s + self.ahead_m, d)
        return Control(command.acceleration, pursue(ego.x, ego.y, ego.heading, *ahead))


def _capped(command: Control, speed: float, most: float) -> Control:
    """The command, but that it brings a speed above `most` down to that."""
    return Control(min(command.acceleration, max(-4.0, 2.0 * (most - speed))), command.steering)
