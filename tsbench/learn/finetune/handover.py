"""Drives that a student begins and an expert ends: what to do where the student gets to, not where experts are.

The idea is DAgger's (Ross et al. 2011), with the expert driving on instead of only being asked.
"""

from __future__ import annotations

from dataclasses import replace

from tsbench.episode.outcome import EpisodeFacts
from tsbench.episode.runner import EpisodeRunner
from tsbench.planners.base import Control, Observation, Planner, PlannerContext, Trajectory
from tsbench.planners.registry import LoadedPlanner, resolve
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.sumo import Simulation


class Takeover:
    """The student's commands until `tick`, then the expert's, who has watched from the start."""

    def __init__(self, student: Planner, expert: Planner) -> None:
        self._student, self._expert = student, expert
        self.tick = 0

    def reset(self, context: PlannerContext) -> None:
        """Start an episode. Only the expert is told the rule."""
        self._expert.reset(context)
        self._student.reset(replace(context, privilege=None))

    def act(self, observation: Observation) -> Control | Trajectory:
        # Asked all along: what an expert remembers of its way depends on what it has seen.
        expert = self._expert.act(observation)
        return (
            expert if observation.step >= self.tick else self._student.act(replace(observation, truth=None))
        )


class Handover:
    """Runs such drives in the process's one simulation."""

    def __init__(self, expert: str, student: Planner, simulation: Simulation, loader: SceneLoader) -> None:
        import torch

        torch.set_num_threads(1)
        self._takeover = Takeover(student, resolve(expert).factory())
        planner = LoadedPlanner("takeover", lambda: self._takeover, privileged=True)
        self._runner = EpisodeRunner(planner, simulation=simulation, loader=loader)

    def drive(self, spec: ScenarioSpec, tick: int) -> EpisodeFacts | None:
        """The episode; None where it ended in an error, or before the takeover."""
        self._takeover.tick = tick
        facts = self._runner.run(spec).facts
        return facts if facts is not None and len(facts.snapshots) > tick else None
