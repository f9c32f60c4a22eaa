"""`tsbench run`'s own episode for an environment: it is asked for steps where a planner is asked for commands.

So an environment drives by the very code that scores planners, errors and ends included.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from tsbench.episode.outcome import EpisodeFacts
from tsbench.episode.perception_level import PerceptionLevel
from tsbench.episode.result import EpisodeResult
from tsbench.episode.runner import EpisodeLoop, Moments
from tsbench.planners.base import Control, Observation, PlannerContext
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.sumo import Simulation


@dataclass(frozen=True, slots=True)
class Step:
    """It is the driver's turn: what is seen, and what was told at the episode's start."""

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
    """The one simulation of this process: one episode at a time, and a new one ends the one before."""

    def __init__(self) -> None:
        self.simulation, self._loader = Simulation(), SceneLoader()
        self._loops: dict[tuple[bool, PerceptionLevel | None], EpisodeLoop] = {}
        self._loop: EpisodeLoop
        self._moments: Moments | None = None
        self._context: PlannerContext
        self.driver: object = None

    def begin(
        self, spec: ScenarioSpec, driver: object, mask_signs: bool, level: PerceptionLevel | None = None
    ) -> Step | EpisodeResult:
        """Start an episode for `driver`, up to its first tick; the result at once where the scene does not load."""
        self.end()
        self.driver = driver
        key = (mask_signs, level)
        if key not in self._loops:
            self._loops[key] = EpisodeLoop(
                mask_signs=mask_signs, simulation=self.simulation, loader=self._loader, perception=level
            )
        self._loop = self._loops[key]
        self._moments = self._loop.play(spec, "env")
        return self._next(None)

    def drive(self, control: Control) -> Step | EpisodeResult:
        """One tick with a command; the result once the episode is over."""
        return self._next(control)

    def _next(self, control: Control | None) -> Step | EpisodeResult:
        assert self._moments is not None
        try:
            moment = self._moments.send(control)
            if isinstance(moment, PlannerContext):
                self._context = moment
                moment = self._moments.send(None)
        except StopIteration as end:
            result: EpisodeResult = end.value
            return result
        assert isinstance(moment, Observation)
        return Step(self._context, moment)

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

    def end(self) -> None:
        if self._moments is not None:
            self._moments.close()
        self._moments, self.driver = None, None

    def close(self) -> None:
        self.end()
        self.simulation.close()


@cache
def process_episode() -> SteppedEpisode:
    """This process's: libsumo has one simulation per process."""
    return SteppedEpisode()
