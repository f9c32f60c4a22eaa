"""`tsbench run`'s own episode, step by step: for environments, for collections of drives, and for a debugger.

So they drive by the very code that scores planners, errors and ends included.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from tsbench.episode.outcome import EpisodeFacts, EpisodeResult, Outcome
from tsbench.episode.perception_level import EXACTLY, Perception
from tsbench.episode.runner import EpisodeLoop, EpisodeSteps
from tsbench.episode.trace import Trace
from tsbench.episode.trace_columns import plan_of_each_tick
from tsbench.planners.base import Control, Observation, PlannerContext, Trajectory
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import WorldSnapshot


@dataclass(frozen=True, slots=True)
class Step:
    """The driver's turn: the observation, and the context from the episode's start."""

    context: PlannerContext
    observation: Observation


@dataclass(frozen=True, slots=True)
class Judged:
    """Clauses violated so far, the wrong way among them, and those of needless obedience, once per event.

    engaged: is the target's rule?
    """

    violations: tuple[str, ...]
    needless: tuple[str, ...]
    engaged: bool

    @classmethod
    def of(cls, facts: EpisodeFacts) -> Judged:
        """What was judged of a whole episode."""
        events = [v.clause for verdict in (facts.target, *facts.others) for v in verdict.violations]
        events += [v.clause for v in facts.wrong_way]
        return cls(tuple(events), tuple(v.clause for v in facts.needless), facts.target.engaged)


class SteppedEpisode:
    """The one simulation of this process: one episode at a time, and a new one ends the one before.

    simulation, loader: those of this process, if they exist already.
    """

    def __init__(self, simulation: Simulation | None = None, loader: SceneLoader | None = None) -> None:
        self.simulation, self._loader = simulation or Simulation(), loader or SceneLoader()
        self._loops: dict[Perception, EpisodeLoop] = {}
        self._loop: EpisodeLoop
        self._steps: EpisodeSteps | None = None
        self._context: PlannerContext
        self.driver: object = None

    def begin(
        self, spec: ScenarioSpec, driver: object, perception: Perception = EXACTLY,
        name: str = "env", privileged: bool = False, floor: bool = False,
    ) -> Step | EpisodeResult:  # fmt: skip
        """Start an episode for `driver`, up to its first tick; the result at once where the scene does not load.

        name, privileged, floor: as `EpisodeLoop.run_episode` takes them.
        """
        self.end()
        self.driver = driver
        if perception not in self._loops:
            self._loops[perception] = EpisodeLoop(
                perception=perception, simulation=self.simulation, loader=self._loader
            )
        self._loop, self._spec, self._name = self._loops[perception], spec, name
        self._steps = self._loop.run_episode(spec, name, privileged, floor)
        return self._next(None)

    def drive(self, control: Control | Trajectory) -> Step | EpisodeResult:
        """One tick with a command; the result once the episode is over."""
        return self._next(control)

    def _next(self, control: Control | Trajectory | None) -> Step | EpisodeResult:
        assert self._steps is not None
        try:
            asked = self._steps.send(control)
            if isinstance(asked, PlannerContext):
                self._context = asked
                asked = self._steps.send(None)
        except StopIteration as end:
            result: EpisodeResult = end.value
            return result
        assert isinstance(asked, Observation)
        return Step(self._context, asked)

    @property
    def snapshot(self) -> WorldSnapshot:
        """The present tick, or the one that ended the episode."""
        episode = self._loop.episode
        assert episode is not None
        return episode.snapshots[-1]

    def last_view(self) -> Observation:
        """The tick that ended the episode, which no planner is shown."""
        episode = self._loop.episode
        assert episode is not None
        return episode.look()

    def judged(self) -> Judged:
        """What the monitors say so far; an excursion that goes on counts."""
        episode = self._loop.episode
        assert episode is not None
        m = episode.monitors
        return Judged(
            tuple(c for monitor in (m.target, *m.others, m.wrong_way) for c in monitor.clauses()),
            tuple(c for monitor in m.needless for c in monitor.clauses()),
            m.target.engaged,
        )

    def against(self) -> tuple[str, ...]:
        """The clauses of what counts against it so far, once per event; an excursion that goes on counts."""
        episode = self._loop.episode
        assert episode is not None
        m = episode.monitors
        return tuple(c for monitor in (m.target, *m.needless, m.wrong_way) for c in monitor.clauses())

    def trace(self) -> Trace:
        """The episode up to the present tick, for pictures of it; an excursion that goes on is no event yet."""
        episode = self._loop.episode
        assert episode is not None
        m = episode.monitors
        needless = [event for one in m.needless for event in one.log.verdict(one.engaged).violations]
        return Trace(
            spec=self._spec,
            planner=self._name,
            outcome=Outcome.TIMEOUT,
            error="",
            contact=None,
            target=m.target.log.verdict(m.target.engaged),
            others=tuple(one.log.verdict(one.engaged) for one in m.others),
            start_remaining_m=episode.start_remaining,
            snapshots=list(episode.snapshots),
            commands=np.array(episode.commands, np.float64).reshape(-1, 2),
            needless=tuple(needless),
            wrong_way=m.wrong_way.log.verdict(m.wrong_way.engaged).violations,
            plans=plan_of_each_tick(tuple(episode.plans), len(episode.snapshots)),
            told=tuple(episode.observer.told),
        )

    def end(self) -> None:
        if self._steps is not None:
            self._steps.close()
        self._steps, self.driver = None, None

    def close(self) -> None:
        self.end()
        self.simulation.close()


@cache
def process_episode() -> SteppedEpisode:
    """This process's: libsumo has one simulation per process."""
    return SteppedEpisode()
