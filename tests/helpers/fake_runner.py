"""An episode runner without SUMO: the ego drives along a straight road as a planner says."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable

import episode_builders
import numpy as np

from tsbench.core.errors import PlannerOutputError, cause_of
from tsbench.episode.outcome import EpisodeResult, Outcome
from tsbench.episode.perception_level import Perception
from tsbench.planners.base import to_command
from tsbench.planners.registry import LoadedPlanner
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.ego import Motion, advance

TICKS = 30
LOADING, SIMULATING, PLANNING, SCORING = 1, 2, 3, 4


class FakeRunner:
    def __init__(
        self, planner: LoadedPlanner, *, perception: Perception, heartbeat: Callable[[int], None], data: DataSet
    ) -> None:
        del data
        self.name, self._factory = planner.name, planner.factory
        self._beat = heartbeat
        self._scene = episode_builders.scene()

    def prepare(self, spec: ScenarioSpec) -> None:
        """A planner is made in each episode."""

    def run(self, spec: ScenarioSpec) -> EpisodeResult:
        self._beat(LOADING)
        self._spec = spec
        self._egos = [episode_builders.ego(10.0 + spec.variant, speed=5.0)]
        outcome, error, detail = Outcome.ARRIVED, "", ""
        try:
            self._drive(spec)
        except PlannerOutputError as problem:
            outcome, error = Outcome.INVALID_OUTPUT, cause_of(problem)
        except Exception as problem:
            outcome, error, detail = (Outcome.PLANNER_ERROR, cause_of(problem), traceback.format_exc())
        broken = [episode_builders.violation(1.0 + spec.variant / 7)] if spec.seed % 3 == 0 else []
        facts = episode_builders.facts(
            self._egos, outcome=outcome, target=episode_builders.verdict(*broken, steps=len(broken)), world=self._scene
        )
        return episode_builders.result(
            facts, self.name, spec=spec, error=error, detail=detail,
            planner_s=np.full(len(self._egos) - 1, 0.001), total_s=0.01,
        )  # fmt: skip

    def _drive(self, spec: ScenarioSpec) -> None:
        self._beat(PLANNING)
        planner = self._factory()
        planner.reset(spec)
        motion = Motion(self._egos[0].x, self._egos[0].y, 0.0, 5.0)
        for _ in range(TICKS):
            self._beat(PLANNING)
            output = planner.act(spec)
            command, _ = to_command(output, motion, self._scene.network)
            self._beat(SIMULATING)
            motion = advance(motion, *command)
            self._egos.append(episode_builders.ego(motion.x, motion.y, motion.heading, motion.speed))
        time.sleep(0.002)

    def close(self) -> None:
        pass
