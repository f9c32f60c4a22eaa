"""What a learned base sees below an expert: only obstacles that stand in the way it is to drive.

Learned planners stop before an obstacle on the lane, as their teachers did, and know no route that leads around it; an
expert that leads them past one would wait for ever.
"""

from __future__ import annotations

import math
from dataclasses import replace

from tsbench.planners.base import Control, Observation, Planner, PlannerContext, Trajectory
from tsbench.planners.common.swept_path import HALF_LENGTH_M

_HALF_WIDTH_M = 1.0
_CLEARANCE_M = 0.3
_WINDOW_M = 60.0


class ObstacleFilter:
    """A base planner without the obstacles beside its route, and without those that it has begun to pass."""

    def __init__(self, base: Planner) -> None:
        self._base = base

    def reset(self, context: PlannerContext) -> None:
        self._base.reset(context)

    def act(self, observation: Observation) -> Control | Trajectory:
        o = observation
        if not o.obstacles:
            return self._base.act(o)
        line, s = o.route.path.line, o.route.s
        kept = []
        for thing in o.obstacles:
            at, aside = line.project(thing.x, thing.y, s - _WINDOW_M, s + _WINDOW_M)
            turned = thing.heading - line.heading_at(at)
            c, n = abs(math.cos(turned)), abs(math.sin(turned))
            wide = 0.5 * (c * thing.width + n * thing.length)
            if at > s - HALF_LENGTH_M and abs(aside) - wide < _HALF_WIDTH_M + _CLEARANCE_M:
                kept.append(thing)
        return self._base.act(replace(o, obstacles=tuple(kept)))
