"""`tsbench run`'s own episode, turned inside out: it asks a planner for commands, an environment is asked for steps.

The episode runs in a greenlet (a stack of its own in the same thread) whose planner, the `SteppedPlanner`, hands each
observation to whoever holds the episode and goes on when a command comes back. So an environment drives by the very
code that scores planners, errors and ends included.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import cast

from greenlet import getcurrent, greenlet

from tsbench.episode.result import EpisodeResult
from tsbench.episode.runner import EpisodeRunner
from tsbench.planners.base import Control, Observation, PlannerContext
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.sumo import Simulation


@dataclass(frozen=True, slots=True)
class Step:
    """It is the driver's turn: what is seen, and what was told at the episode's start."""

    context: PlannerContext
    observation: Observation


class SteppedPlanner:
    """The planner that the episode sees."""

    def reset(self, context: PlannerContext) -> None:
        """Keep it for the driver."""
        self._context = context

    def act(self, observation: Observation) -> Control:
        """Whatever the driver says, whenever it says so."""
        return cast("Control", getcurrent().parent.switch(Step(self._context, observation)))


class SteppedEpisode:
    """The one simulation of this process: one episode at a time, and a new one ends the one before."""

    def __init__(self) -> None:
        self._simulation = Simulation()
        self._loader = SceneLoader()
        self._runners: dict[bool, EpisodeRunner] = {}
        self._episode: greenlet | None = None
        self.driver: object = None

    def begin(self, spec: ScenarioSpec, driver: object, mask_signs: bool) -> Step | EpisodeResult:
        """Start an episode for `driver`, up to its first tick; the result at once where the scene does not load."""
        self.end()
        if mask_signs not in self._runners:
            self._runners[mask_signs] = EpisodeRunner(
                f"{__name__}:SteppedPlanner",
                "env",
                mask_signs=mask_signs,
                simulation=self._simulation,
                loader=self._loader,
            )
        self.driver = driver
        self._episode = greenlet(self._runners[mask_signs].run)
        return cast("Step | EpisodeResult", self._episode.switch(spec))

    def drive(self, control: Control) -> Step | EpisodeResult:
        """One tick with a command; the result once the episode is over."""
        assert self._episode is not None
        # Control comes back to whoever asks now.
        self._episode.parent = getcurrent()
        return cast("Step | EpisodeResult", self._episode.switch(control))

    def end(self) -> None:
        """Drop the episode that runs, if one does."""
        if self._episode is not None and not self._episode.dead:
            self._episode.parent = getcurrent()
            self._episode.throw()
        self._episode, self.driver = None, None

    def close(self) -> None:
        """End the episode and SUMO."""
        self.end()
        self._simulation.close()


@cache
def process_episode() -> SteppedEpisode:
    """This process's: libsumo has one simulation per process."""
    return SteppedEpisode()
