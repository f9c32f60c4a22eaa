"""Drivers that read no plate and are as slow as is just not needless: docs/without_reading.md.

`Peeks` comes to its line at half the speed that is open, so as to see what others do, and stops there if the first
vehicle of another arm does not brake hard for its own line. `Lowest` is slow everywhere. Units: m, s, m/s, m/s2.
"""

from __future__ import annotations

import math

import numpy as np

from tsbench import Control, Observation, PlannerContext
from tsbench.planners.floor.constraints import Polite
from tsbench.planners.floor.guess import masked
from tsbench.planners.geometry import HALF_LENGTH_M
from tsbench.planners.idm import Idm
from tsbench.rules.open_speed import at_metre, bend_speeds
from tsbench.signs.catalog import load_catalog
from tsbench.sim.world import DT_S, ActorKind

# What is needless, as it is judged: the speed that is open to the ego comes from this.
_NEEDLESS = load_catalog().needless
_RULE, _CRUISE = _NEEDLESS.thresholds, _NEEDLESS.thresholds["cruise_ratio"]
# So slow, as a share of the open speed, is just not needless. So far before a junction, or people, it is that slow.
_LEAST, _CREEP_M, _WALKS_M = 0.53, 18.0, 9.0
# So near it looks at what others do; behind the passage it hurries no more.
_SHOWS_M, _PASSAGE_M = 5.0, 20.0
_CALM_MPS2, _HARD_MPS2 = 2.5, 6.0
# SUMO's cars brake for a line that binds them as late as they can. Who is nearer than that and does not, will not.
_LATEST_MPS2, _NEAR_M, _COMES_S = 7.5, 6.0, 6.0
# Who crosses the ego's way, by number: speed, acceleration, way to its own line.
_Cars = dict[int, tuple[float, float, float]]


class _Open:
    """The speed that is open to the ego, as it is judged where nobody is ahead. cruise: share of the limit."""

    def __init__(self, cruise: float) -> None:
        self._cruise, self._path, self.speed = cruise, None, 0.0

    def update(self, seen: Observation) -> float:
        """The speed at this tick."""
        path, v = seen.route.path, seen.ego.speed
        if path is not self._path:
            self._path, self._bends = path, bend_speeds(path.line, _NEEDLESS)
        front, limit = seen.route.s + HALF_LENGTH_M, path.limit_at(seen.route.s)
        calm = min(math.sqrt(self.speed**2 + 2.0 * _RULE["calm_mps2"] * v * DT_S), self._cruise * limit)
        self.speed = max(v, min(max(self.speed, calm), limit, at_metre(self._bends, front)))
        return self.speed


class Lowest:
    """`idm`, and everywhere at 0.72 of the speed that is open to it."""

    floor, sign_access, share = True, False, 0.72

    def reset(self, context: PlannerContext) -> None:
        self._base, self._open = Idm(), _Open(1.0)
        self._base.reset(context)

    def act(self, observation: Observation) -> Control:
        seen = masked(observation)
        command, v = self._base.act(seen), seen.ego.speed
        slow = max(-4.0, 2.0 * (self.share * self._open.update(seen) - v))
        return Control(min(command.acceleration, slow), command.steering)


class Peeks:
    """As slowly as is allowed to the line; there it stops for who comes on, and hurries where the first one brakes."""

    floor, sign_access = True, False

    def reset(self, context: PlannerContext) -> None:
        self._context, self._map, self._base = context, context.network, Idm()
        self._base.reset(context)
        self._path: object = None
        self._verdict, self._since, self._slow, self._last = "", 0, False, _Cars()
        self._opened = _Open(_CRUISE)

    def act(self, observation: Observation) -> Control:
        seen = masked(observation)
        path, command = seen.route.path, self._base.act(seen)
        if self._path is None:
            ways, self._edge = set(path.edges), path.edges[0]
            self._strip = next((c for c in self._map.crossings.values() if ways & set(c.edges)), None)
            self._road = Polite(self._context, "" if self._strip else self._edge)
        if path is not self._path:
            self._path, self._line = path, self._road.line_on(path)
        front, limit = seen.route.s + HALF_LENGTH_M, path.limit_at(seen.route.s)
        self._open = self._opened.update(seen)
        return Control(self._wanted(seen, command.acceleration, self._line - front, limit), command.steering)

    def _wanted(self, seen: Observation, plain: float, to_line: float, limit: float) -> float:
        v, least, cars = seen.ego.speed, _LEAST * self._open, self._cars(seen)
        near = _WALKS_M if self._strip else _CREEP_M
        self._slow = self._slow or to_line < near + (v * v - least * least) / (2.0 * _CALM_MPS2)
        if not self._verdict:
            self._verdict, self._since = self._judge(seen, cars, to_line, v), seen.step
        self._last = cars
        if self._verdict == "stop":
            waited = seen.step - self._since
            if v < 0.2 and (waited > 250 or (waited > 15 and not self._busy(seen, cars))):
                self._verdict = "clear"
            return -_HARD_MPS2
        if self._verdict == "go" and to_line > -_PASSAGE_M:
            return min(plain if plain < 0.0 else 3.0, 4.0 * (max(self._open, _LEAST * limit) - v))
        if self._verdict:
            return plain
        wanted = min(plain, 2.0 * (max(self._open, _CRUISE * limit) - v))
        return min(wanted, max((least - v) / 0.2, -3.0)) if self._slow else wanted

    def _judge(self, seen: Observation, cars: _Cars, to_line: float, v: float) -> str:
        """What others have just shown. At the last moment at which it can stop, it stops if anybody comes."""
        late = to_line - v * v / (2.0 * _HARD_MPS2) - v * DT_S < (-0.3 if self._strip else -0.05)
        if self._strip:
            return "stop" if to_line < _WALKS_M and self._busy(seen, cars) else "go" if late else ""
        shown = ""
        for name, (speed, change, left) in cars.items() if to_line < _SHOWS_M - v * DT_S else ():
            before, _, way = self._last.get(name, cars[name])
            if 0.0 < left < _NEAR_M and speed > 1.0:
                if way < before**2 / (2.0 * _LATEST_MPS2) - 0.1 and change > -0.5:
                    return "stop"
                shown = "go" if change < -1.0 else shown
        return shown or ("" if not late else "stop" if self._busy(seen, cars) else "go")

    def _cars(self, seen: Observation) -> _Cars:
        found, actors, roads, now = _Cars(), seen.actors, self._map, seen.ego.heading
        for k in np.flatnonzero((actors.lane >= 0) & (actors.kind != ActorKind.PEDESTRIAN)).tolist():
            lane, (x, y, heading) = roads.lanes[int(actors.lane[k])], actors.pose[k].tolist()
            crosses = abs(math.sin(heading - now)) > 0.6 and not lane.internal
            if crosses and roads.edges[lane.edge].target == roads.edges[self._edge].target:
                name, speed, gone = int(actors.ids[k]), float(actors.speed[k]), lane.line.project(x, y)[0]
                change = (speed - self._last.get(name, (speed,))[0]) / DT_S
                found[name] = speed, change, lane.line.length - gone - 0.5 * float(actors.length[k])
        return found

    def _busy(self, seen: Observation, cars: _Cars) -> bool:
        if self._strip is None:
            return any(left < _COMES_S * max(speed, 2.0) for speed, _, left in cars.values())
        line, actors = self._strip.line, seen.actors
        people = actors.pose[(actors.kind == ActorKind.PEDESTRIAN) & (actors.speed > 0.1), :2].tolist()
        return any(math.dist(p, line.point_at(line.project(*p)[0])) < 2.5 for p in people)
