"""What a learned base sees below an expert."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from learned_scenes import record

from tsbench.planners.base import Control, PlannerContext
from tsbench.planners.experts.expert import ObstacleFilter
from tsbench.planners.observation import Observation
from tsbench.sim.scene import Obstacle


class Looker:
    """Remembers the obstacles that it is shown."""

    def reset(self, context: PlannerContext) -> None:
        self.shown: tuple[str, ...] = ()

    def act(self, observation: Observation) -> Control:
        self.shown = tuple(o.id for o in observation.obstacles)
        return Control(0.0, 0.0)


@pytest.mark.parametrize(
    ("ahead", "aside", "turned", "shown"),
    [
        (20.0, 0.0, 0.0, True),
        (20.0, 2.2, 0.0, True),
        (20.0, 2.4, 0.0, False),
        (20.0, -2.4, 0.0, False),
        # Across the road it is 6 m wide.
        (20.0, 3.5, 90.0, True),
        (20.0, 4.5, 90.0, False),
        (-1.0, 0.0, 0.0, True),
        (-3.0, 0.0, 0.0, False),
    ],
)
def test_only_what_stands_in_the_way_is_shown(ahead: float, aside: float, turned: float, shown: bool) -> None:
    drive = record()
    o, looker = drive.seen[-1], Looker()
    line, at = o.route.path.line, o.route.s + ahead
    x, y = line.point_at(at, aside)
    heading = line.heading_at(at) + math.radians(turned)
    planner = ObstacleFilter(looker)
    planner.reset(drive.context)
    planner.act(replace(o, obstacles=(Obstacle("island", "island", x, y, heading, 6.0, 2.0, ""),)))
    assert looker.shown == (("island",) if shown else ())
