"""Drivers that read no plate and wait for others to tell: they stand, crawl, stop and go, or leave their lane.

Whatever they do, others must do the same in both halves of a pair until the ego waits at its line, or cannot stop any
more before it meets them.
Source: docs/contrast.md, "Reaction must not be enough". Units: m, s, m/s, m/s2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from tsbench.core.seeds import rng_of
from tsbench.planners.base import Control, Observation, PlannerContext
from tsbench.planners.idm import Idm, IdmParameters
from tsbench.planners.lane_change import AHEAD_S, LEAST_AHEAD_M
from tsbench.sim.convoy import Approach, Showing
from tsbench.sim.ego import pursue
from tsbench.sim.world import DT_S, Agents, EgoState

_CRAWL_MPS = 1.5
_BRAKE_MPS2, _HARD_MPS2 = 2.5, 6.0
_STANDS_MPS = 0.05
_NEAR_M = 1.0
# Those who leave their lane look so much farther ahead than others: it is left over some metres.
_SWING_M = 4.0
_BESIDE_M = 48.0
_OTHER_LANE_M, _VERGE_M = 3.0, 2.2
# How many of them a certificate tries on a pair.
_TRIED = 2


@dataclass(frozen=True, slots=True)
class Habit:
    """One way to watch.

    stops: of each stop the place of the front, m before the line, and its time, s. top_speed: at most, m/s. slow: from
    so many metres before the line on, at most so fast, m/s; None: as the road allows. beside: from so many metres
    before the line on, for 48 m, so far to the left, m; None: in its lane.
    """

    name: str
    stops: tuple[tuple[float, float], ...] = ()
    top_speed: float = math.inf
    beside: tuple[float, float] | None = None
    slow: tuple[float, float] | None = None


HABITS = (
    *(Habit(f"stands at {m:.0f} m", ((m, 40.0),)) for m in (45.0, 30.0, 20.0, 13.0, 8.0, 5.5)),
    Habit("crawls", top_speed=_CRAWL_MPS),
    Habit("stops and goes", tuple((m, 3.0) for m in (50.0, 40.0, 30.0, 20.0, 14.0, 10.0, 6.0))),
    *(Habit(f"comes at {v:g} m/s", slow=(18.0, v)) for v in (2.0, 3.0, 4.5)),
    Habit("takes the lane beside", ((20.0, 20.0),), beside=(55.0, _OTHER_LANE_M)),
    Habit("takes the verge", ((20.0, 20.0),), beside=(45.0, -_VERGE_M)),
)


def drawn_habits(pair: str) -> tuple[Habit, ...]:
    """The habits that the certificate of a pair of this name tries."""
    drawn = rng_of("watching", pair).choice(len(HABITS), size=_TRIED, replace=False)
    return tuple(HABITS[k] for k in sorted(drawn.tolist()))


def braking_to_meet(approach: Approach, showing: Showing, ego: EgoState) -> float:
    """Deceleration with which an ego stops before it meets others, while they may not show it anything; m/s2."""
    return ego.speed**2 / (2.0 * (approach.to_line(ego) + showing.zone_m))


class Watcher:
    """A habit at the wheel. approach: tells it where its line is. It brakes for nobody: that would be a reason."""

    privileged = False
    sign_access = False

    def __init__(self, habit: Habit, approach: Approach) -> None:
        self._habit, self._approach = habit, approach
        self._base = Idm(IdmParameters(top_speed=habit.top_speed))
        self._stops: list[list[float]] = []

    def reset(self, context: PlannerContext) -> None:
        """Begin anew."""
        self._base.reset(context)
        self._stops = [list(stop) for stop in self._habit.stops]

    def act(self, observation: Observation) -> Control:
        """The base planner's command, or a harder brake for the next stop."""
        ego = observation.ego
        to_line = self._approach.to_line(ego)
        command = self._base.act(replace(observation, actors=Agents.none()))
        accel, steering = command.acceleration, command.steering
        while self._stops and (self._stops[0][1] <= 0.0 or to_line < self._stops[0][0] - _NEAR_M):
            self._stops.pop(0)
        if self._stops:
            room = to_line - self._stops[0][0]
            if ego.speed <= _STANDS_MPS and room < _NEAR_M:
                self._stops[0][1] -= DT_S
                accel = min(accel, -ego.speed / DT_S)
            elif ego.speed**2 > 2.0 * _BRAKE_MPS2 * max(room - 0.3, 0.0):
                accel = min(accel, -_BRAKE_MPS2 if room > 0.0 else -_HARD_MPS2)
        slow, beside = self._habit.slow, self._habit.beside
        if slow is not None and to_line < slow[0]:
            accel = min(accel, max((slow[1] - ego.speed) / 0.5, -_BRAKE_MPS2))
        if beside is not None and beside[0] - _BESIDE_M < to_line < beside[0]:
            route = observation.route
            ahead = route.s + max(LEAST_AHEAD_M + _SWING_M, AHEAD_S * ego.speed)
            steering = pursue(ego.x, ego.y, ego.heading, *route.path.line.point_at(ahead, beside[1]))
        return Control(accel, steering)
