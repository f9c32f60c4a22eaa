"""Runs episodes with a planner: errors become outcomes, and the planner is made once."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Generator
from contextlib import suppress

import numpy as np

from tsbench.core.errors import InputError, PlannerOutputError, SimulationError, cause_of
from tsbench.core.seeds import floor_seed, planner_seed
from tsbench.episode.episode import Episode
from tsbench.episode.observation import Observer, destination_on_map
from tsbench.episode.outcome import EpisodeResult, Outcome, Phase
from tsbench.episode.perception_level import EXACTLY, Perception
from tsbench.planners.base import Control, Observation, Planner, PlannerContext, Privilege, Trajectory
from tsbench.planners.registry import LoadedPlanner
from tsbench.scenarios.scene_loader import Roads, SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.signs.annotations import DISTRACTOR
from tsbench.sim.scene import Scene
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S

# An episode as its driver sees it: it yields a context, then an observation a tick, and returns the result. The driver
# answers the context with None, and each observation with what the planner returned for it.
EpisodeSteps = Generator[PlannerContext | Observation, Control | Trajectory | None, EpisodeResult]


class PlannerFailure(Exception):
    """Wraps whatever the planner's code raised, also SystemExit. Thrown into an episode to end it."""


def _no_heartbeat(_: int) -> None:
    return None


class EpisodeLoop:
    """Runs episodes one after the other in the process's one simulation; the caller supplies the commands.

    heartbeat: called with a `Phase` at each change, so that a watchdog knows who is late. simulation, loader: those of
    this process, if they exist already.
    """

    def __init__(
        self,
        *,
        perception: Perception = EXACTLY,
        heartbeat: Callable[[int], None] = _no_heartbeat,
        simulation: Simulation | None = None,
        loader: SceneLoader | None = None,
    ) -> None:
        self._perception, self._beat = perception, heartbeat
        self.simulation = Simulation() if simulation is None else simulation
        self._loader = SceneLoader() if loader is None else loader
        self.episode: Episode | None = None

    def prepare(self, spec: ScenarioSpec) -> None:
        """Load the roads of a row, unless they cannot be loaded."""
        self._beat(Phase.LOADING)
        with suppress(InputError):
            _ = self._loader.load(spec)[1].view

    def run_episode(
        self, spec: ScenarioSpec, planner: str, privileged: bool = False, floor: bool = False
    ) -> EpisodeSteps:
        """One episode. Never raises for what a scene or planner does: that becomes an error outcome with its cause.

        planner: its name in the result. privileged: is it told the rule? floor: is its seed the row's, not the pair's?
        """
        began = time.perf_counter()
        episode: Episode | None = None
        outcome, error, detail = Outcome.SIM_ERROR, "", ""
        try:
            self._beat(Phase.LOADING)
            scene, roads = self._loader.load(spec)
            scene.catalog.check_plates(
                spec.sign_code, {s.id: s.code for s in scene.signs if s.role != DISTRACTOR}, spec.scenario_id
            )
            observer = Observer(scene, roads.view, self._perception, spec.pair_name, privileged)
            episode = Episode(self.simulation, scene, roads, observer, self._beat)
            self.episode = episode
            seed = floor_seed(spec.scenario_id) if floor else planner_seed(spec.pair_name)
            context = self._context(seed, scene, roads, privileged)
            self._beat(Phase.PLANNING)
            yield context
            episode.start_s = time.perf_counter() - began
            outcome = yield from episode.drive()
        except PlannerOutputError as problem:
            outcome, error = Outcome.INVALID_OUTPUT, _line(problem)
        except PlannerFailure as problem:
            outcome, error = Outcome.PLANNER_ERROR, _line(problem.__cause__ or problem)
            detail = traceback.format_exc()
        except (InputError, SimulationError) as problem:
            error = _line(problem)
            detail = traceback.format_exc()
        except Exception as problem:
            # A defect of ours (a monitor, say) is an episode error with its traceback, never "no violation".
            error = f"internal error: {_line(problem)}"
            detail = traceback.format_exc()
        facts = None
        if episode is not None and episode.snapshots:
            try:
                facts = episode.facts(outcome)
            except Exception as problem:
                outcome, error = Outcome.SIM_ERROR, f"internal error: {_line(problem)}"
                detail += traceback.format_exc()
        self._beat(Phase.IDLE)
        return EpisodeResult(
            spec=spec, planner=planner, outcome=outcome, error=error, detail=detail, facts=facts,
            commands=np.array(episode.commands if episode else [], dtype=np.float64).reshape(-1, 2),
            planner_s=np.array(episode.planner_s if episode else [], dtype=np.float64),
            start_s=episode.start_s if episode else 0.0,
            sim_s=episode.sim_s if episode else 0.0,
            total_s=time.perf_counter() - began,
            plans=tuple(episode.plans) if episode else (),
            told=episode.observer.told if episode else (),
        )  # fmt: skip

    def _context(self, seed: int, scene: Scene, roads: Roads, privileged: bool) -> PlannerContext:
        view, privilege = roads.view, None
        if privileged:
            sign = scene.target_sign
            privilege = Privilege(sign, scene.rule(sign), scene.network, view)
        return PlannerContext(seed, view.map, view.graph, destination_on_map(view, scene), DT_S, privilege)


class EpisodeRunner:
    """Runs episodes one after the other with one planner, made when the first begins. options: as `EpisodeLoop`'s."""

    def __init__(
        self,
        planner: LoadedPlanner,
        *,
        perception: Perception = EXACTLY,
        heartbeat: Callable[[int], None] = _no_heartbeat,
        simulation: Simulation | None = None,
        loader: SceneLoader | None = None,
    ) -> None:
        self._loaded = planner
        self._planner: Planner | None = None
        self._loop = EpisodeLoop(
            perception=perception, heartbeat=heartbeat, simulation=simulation, loader=loader
        )

    @property
    def simulation(self) -> Simulation:
        return self._loop.simulation

    def prepare(self, spec: ScenarioSpec) -> None:
        """Make the planner and load the roads of a row, for children of this process to begin with.

        Raises whatever the planner's constructor does; roads that cannot be loaded are found in the episode.
        """
        if self._planner is None:
            self._planner = self._loaded.factory()
        self._loop.prepare(spec)

    def run(self, spec: ScenarioSpec) -> EpisodeResult:
        """One episode; of what its code raises, only KeyboardInterrupt reaches the caller."""
        loaded = self._loaded
        steps = self._loop.run_episode(spec, loaded.name, loaded.privileged, loaded.floor)
        try:
            asked = next(steps)
            while True:
                try:
                    answer = self._answer(asked)
                except KeyboardInterrupt:
                    raise
                except BaseException as problem:
                    failure = PlannerFailure()
                    failure.__cause__ = problem
                    asked = steps.throw(failure)
                else:
                    asked = steps.send(answer)
        except StopIteration as end:
            result: EpisodeResult = end.value
            return result

    def _answer(self, asked: PlannerContext | Observation) -> Control | Trajectory | None:
        if isinstance(asked, PlannerContext):
            if self._planner is None:
                self._planner = self._loaded.factory()
            self._planner.reset(asked)
            return None
        assert self._planner is not None
        return self._planner.act(asked)

    def close(self) -> None:
        self.simulation.close()


def _line(error: BaseException) -> str:
    return cause_of(error)[:500]
