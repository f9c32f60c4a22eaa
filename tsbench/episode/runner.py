"""One episode: the closed loop of simulation, navigation, monitors and planner. The hot path of the product."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from enum import IntEnum

import numpy as np

from tsbench.core.errors import InputError, PlannerOutputError, SimulationError, cause_of
from tsbench.episode.command import to_command
from tsbench.episode.observation import Observer
from tsbench.episode.outcome import EpisodeFacts, Outcome, TerminationCheck
from tsbench.episode.result import EpisodeResult
from tsbench.planners.base import Planner, PlannerContext, Privilege
from tsbench.planners.registry import LoadedPlanner, resolve
from tsbench.rules.registry import make_monitors
from tsbench.scenarios.scene_loader import Roads, SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.signs.catalog import Catalog, load_catalog
from tsbench.sim.convoy import ConvoyRelease
from tsbench.sim.ego import advance, start_motion
from tsbench.sim.navigation import Navigator, RouteView
from tsbench.sim.scene import Scene
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S, EgoState, WorldSnapshot


class Phase(IntEnum):
    """What a worker is doing, for whoever watches over it."""

    IDLE = 0
    LOADING = 1
    SIMULATING = 2
    PLANNING = 3
    SCORING = 4


class PlannerFailure(Exception):
    """The planner's own code raised, be it SystemExit; KeyboardInterrupt is left to whoever runs the process."""


def _no_heartbeat(_: int) -> None:
    return None


class EpisodeRunner:
    """Runs episodes one after the other with one planner, in one process.

    heartbeat: called with a `Phase` at each change, so that a watchdog knows who is late. simulation, loader: the
    process's one simulation and a loader of scenes, where somebody else has them already.
    """

    def __init__(
        self,
        planner_spec: str,
        planner_name: str,
        *,
        mask_signs: bool = False,
        device: str = "cpu",
        heartbeat: Callable[[int], None] = _no_heartbeat,
        simulation: Simulation | None = None,
        loader: SceneLoader | None = None,
    ) -> None:
        self.name = planner_name
        self._loaded: LoadedPlanner = resolve(planner_spec)
        self._device = device
        self._planner: Planner | None = None
        self._mask = mask_signs
        self._beat = heartbeat
        self.simulation = Simulation() if simulation is None else simulation
        self._loader = SceneLoader() if loader is None else loader
        self._catalog: Catalog = load_catalog()

    def run(self, spec: ScenarioSpec) -> EpisodeResult:
        """One episode. Never raises for what a scene or planner does: that becomes an error outcome with its cause."""
        began = time.perf_counter()
        episode: Episode | None = None
        outcome, error, detail = Outcome.SIM_ERROR, "", ""
        try:
            self._beat(Phase.LOADING)
            scene, roads = self._loader.load(spec)
            self._catalog.check_plates(spec.sign_code, {s.id: s.code for s in scene.signs}, spec.scenario_id)
            episode = Episode(self.simulation, scene, roads, self._catalog, self._mask, self._beat)
            planner = self._make_planner(spec, scene, roads)
            episode.start_s = time.perf_counter() - began
            outcome = episode.drive(planner)
        except PlannerOutputError as problem:
            outcome, error = Outcome.INVALID_OUTPUT, _line(problem)
        except PlannerFailure as problem:
            cause = problem if problem.__cause__ is None else problem.__cause__
            outcome, error = Outcome.PLANNER_ERROR, _line(cause)
            detail = traceback.format_exc()
        except (InputError, SimulationError) as problem:
            error = _line(problem)
            detail = traceback.format_exc()
        except Exception as problem:
            # A defect of ours (a monitor, say) is an episode error with its traceback, never "no violation".
            error = f"internal error: {_line(problem)}"
            detail = traceback.format_exc()
        self._beat(Phase.IDLE)
        total = time.perf_counter() - began
        return self._result(spec, outcome, error, detail, episode, total)

    def _make_planner(self, spec: ScenarioSpec, scene: Scene, roads: Roads) -> Planner:
        sign = scene.target_sign
        privilege = None
        if self._loaded.privileged:
            privilege = Privilege(sign, self._catalog.sign(sign.code).rule)
        seed = int(np.random.SeedSequence(spec.seed, spawn_key=(0x9A,)).generate_state(1)[0])
        context = PlannerContext(seed, scene.network, roads.graph, scene.destination, DT_S, privilege)
        self._beat(Phase.PLANNING)
        try:
            if self._planner is None:
                self._planner = self._loaded.factory()
            self._planner.reset(context)
        except KeyboardInterrupt:
            raise
        except BaseException as problem:
            raise PlannerFailure("reset") from problem
        return self._planner

    def _result(
        self,
        spec: ScenarioSpec,
        outcome: Outcome,
        error: str,
        detail: str,
        episode: Episode | None,
        total: float,
    ) -> EpisodeResult:
        facts = None
        if episode is not None and episode.snapshots:
            try:
                facts = episode.facts(outcome)
            except Exception as problem:
                outcome, error = Outcome.SIM_ERROR, f"internal error: {_line(problem)}"
                detail += traceback.format_exc()
        commands = episode.commands if episode else []
        return EpisodeResult(
            spec=spec, planner=self.name, outcome=outcome, error=error, detail=detail, facts=facts,
            commands=np.array(commands, dtype=np.float64).reshape(-1, 2),
            planner_s=np.array(episode.planner_s if episode else [], dtype=np.float64),
            start_s=episode.start_s if episode else 0.0,
            sim_s=episode.sim_s if episode else 0.0,
            total_s=total,
        )  # fmt: skip

    def close(self) -> None:
        """End SUMO."""
        self.simulation.close()


def _line(error: BaseException) -> str:
    return cause_of(error)[:500]


class Episode:
    """The state of one episode in its loop."""

    def __init__(
        self,
        sim: Simulation,
        scene: Scene,
        roads: Roads,
        catalog: Catalog,
        mask: bool,
        beat: Callable[[int], None],
    ) -> None:
        self.sim, self.scene, self.roads, self._beat = sim, scene, roads, beat
        self.snapshots: list[WorldSnapshot] = []
        self.commands: list[tuple[float, float]] = []
        self.planner_s: list[float] = []
        self.sim_s = 0.0
        self.target, self.others = make_monitors(catalog, scene)
        self.ending = TerminationCheck(scene, self.target)
        self.navigator = Navigator(roads.graph, scene.destination)
        self.observer = Observer(scene, mask)
        self.release = ConvoyRelease(scene.convoy, scene.network) if scene.convoy else None
        self.walk = ConvoyRelease(scene.walkers, scene.network) if scene.walkers else None
        start = scene.network.lane(scene.start.lane)
        self.motion = start_motion(scene)
        self.ego = self._locate(start.index)
        sim.load_scene(scene)
        sim.start_ego(self.motion, start.edge, start.order)
        if scene.convoy:
            for vehicle in scene.convoy.vehicles:
                sim.hold(vehicle)
        if scene.walkers:
            sim.hold_persons(scene.walkers.persons)
        # One more step brings the ego to its exact pose and fills the first view.
        sim.step()
        self.route: RouteView = self.navigator.update(self.ego)
        self.start_remaining = self.route.remaining
        self.intent: tuple[str, ...] = ()
        self._shown: tuple[str, ...] = ()
        self._shown_on = -1
        self._take(0)
        self.start_s = 0.0

    def _locate(self, last: int) -> EgoState:
        m = self.motion
        lane, s, d, on_road = self.roads.locator.locate(m.x, m.y, m.heading, last)
        return EgoState(
            m.x, m.y, m.heading, m.speed, m.acceleration, m.steering, m.yaw_rate, lane, s, d, on_road
        )  # fmt: skip

    def _take(self, step: int) -> bool:
        """Read the world after a step; False if the ego has left the map."""
        actors = self.sim.actors()
        if actors is None:
            return False
        self.snapshots.append(WorldSnapshot(step, step * DT_S, self.ego, actors))
        return True

    def drive(self, planner: Planner) -> Outcome:
        """The loop, until exactly one outcome."""
        clock = time.perf_counter
        beat, monitors = self._beat, (self.target, *self.others)
        step = 0
        while True:
            snapshot = self.snapshots[-1]
            beat(Phase.SCORING)
            for monitor in monitors:
                monitor.update(snapshot)
            ended = self.ending.at(snapshot)
            if ended is not None:
                return ended
            observation = self.observer.observe(snapshot, self.route)
            beat(Phase.PLANNING)
            t0 = clock()
            try:
                output = planner.act(observation)
            except KeyboardInterrupt:
                raise
            except BaseException as problem:
                raise PlannerFailure("act") from problem
            t1 = clock()
            # What it returned is its own code still.
            command, self.intent = to_command(output, self.motion, self.scene.network)
            beat(Phase.SIMULATING)
            self.planner_s.append(t1 - t0)
            self.commands.append(command)
            self.motion = advance(self.motion, *command)
            self.ego = self._locate(self.ego.lane)
            step += 1
            if not self._simulate(step):
                return Outcome.OFF_ROAD
            self.route = self.navigator.update(self.ego)
            self.sim_s += clock() - t1

    def _simulate(self, step: int) -> bool:
        sim, ego = self.sim, self.ego
        if self.release is not None and self.release.update(ego):
            assert self.scene.convoy is not None
            for vehicle in self.scene.convoy.vehicles:
                sim.release(vehicle)
        if self.walk is not None and self.walk.update(ego):
            assert self.scene.walkers is not None
            for person, speed in zip(self.scene.walkers.persons, self.scene.walkers.speeds, strict=True):
                sim.let_walk(person, speed)
        shown = self.intent or self.route.path.edges
        if ego.lane != self._shown_on:
            # Inside a junction SUMO may take the ego for another path's, and forgets its way for that one's.
            self._shown, self._shown_on = (), ego.lane
        if shown is not self._shown and (shown == self._shown or self._show(shown)):
            self._shown = shown
        if ego.lane >= 0:
            lane = self.scene.network.lanes[ego.lane]
            sim.place_ego(self.motion, lane.edge, lane.order)
        else:
            sim.place_ego(self.motion, "", -1)
        sim.step()
        return self._take(step)

    def _show(self, edges: tuple[str, ...]) -> bool:
        try:
            return self.sim.set_route(edges)
        except SimulationError as problem:
            if self.intent:
                raise PlannerOutputError(f"intent is no way through the network: {problem}") from problem
            raise

    def facts(self, outcome: Outcome) -> EpisodeFacts:
        """Everything that happened, with the verdicts closed."""
        return EpisodeFacts(
            scene=self.scene, snapshots=self.snapshots, route=self.route, start_remaining_m=self.start_remaining,
            outcome=outcome, contact=self.ending.contact, target=self.target.finish(),
            others=tuple(m.finish() for m in self.others),
        )  # fmt: skip
