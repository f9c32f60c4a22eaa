"""The lawless driver: it obeys no sign, ignores all others and must be caught in nearly every scene.

It is what `--planner tsbench.make.certify.lawless:Lawless` drives. Source: docs/scenes.md, "Certificates".
Units: m/s.
"""

from __future__ import annotations

from dataclasses import replace

from tsbench.planners.base import Control, PlannerContext
from tsbench.planners.idm import Idm, IdmParameters
from tsbench.planners.observation import Observation
from tsbench.sim.world import Agents

_MIN_SPEED = "4.6"
_CRAWL_MPS = 20.0 / 3.6
_FAST = IdmParameters(speed_factor=1.3, accel=3.0, lateral=3.0)
_SLOW = replace(_FAST, top_speed=_CRAWL_MPS)


class Lawless:
    """Drives 1.3 times the road's limit along the navigation's way, in its lane, as if it were alone.

    Where a sign on that way asks for a least speed it crawls: a fast driver could not break that.
    """

    privileged = False
    sign_access = True

    def __init__(self) -> None:
        self._driver = Idm(_FAST)

    def reset(self, context: PlannerContext) -> None:
        self._driver = Idm(_FAST)
        self._driver.reset(context)
        self._context = context

    def act(self, observation: Observation) -> Control:
        own = observation.route.path.edges
        if observation.step == 0 and any(s.code == _MIN_SPEED and s.edge in own for s in observation.signs):
            self._driver = Idm(_SLOW)
            self._driver.reset(self._context)
        return self._driver.act(replace(observation, actors=Agents.none(), obstacles=()))
