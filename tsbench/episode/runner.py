"""One episode: the closed loop of simulation, navigation, monitors and planner. The hot path of the product."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from tsbench.core.errors import InputError, PlannerOutputError, SimulationError, cause_of
from tsbench.core.plain import from_plain
from tsbench.core.seeds import floor_seed, planner_seed
from tsbench.episode.command import Plan, to_command, to_plan
from tsbench.episode.observation import Observer, destination_on_map, ego_on_map
from tsbench.episode.outcome import EpisodeFacts, Outcome, TerminationCheck
from tsbench.episode.perception_level import PerceptionLevel
from tsbench.episode.phase import Phase
from tsbench.episode.result import EpisodeResult
from tsbench.planners.base import Control, Observation, Planner, PlannerContext, Privilege, Trajectory
from tsbench.planners.registry import LoadedPlanner
from tsbench.rules.registry import make_monitors
from tsbench.scenarios.scene_loader import Roads, SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.signs.annotations import DISTRACTOR
from tsbench.signs.catalog import Catalog, load_catalog
from tsbench.sim.convoy import ConvoyRelease
from tsbench.sim.ego import advance, start_motion
from tsbench.sim.navigation import Navigator, RouteView
from tsbench.sim.scene import Scene
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S, EgoState, WorldSnapshot

# An episode as its driver sees it: a context, then an observation a tick. It is sent None for the first, and for each
# of the others what the planner said to it; it returns the result.
Moments = Generator[PlannerContext | Observation, Control | Trajectory | None, EpisodeResult]


class PlannerFailure(Exception):
    """The planner's own code raised what is its cause, be it SystemExit. Thrown into an episode to end it."""


def _no_heartbeat(_: int) -> None:
    return None


class EpisodeLoop:
    """Episodes one after the other in the process's one simulation, for whoever has the commands.

    heartbeat: called with a `Phase` at each change, so that a watchdog knows who is late. simulation, loader: those of
    this process, where somebody else has them already. perception: None = exact.
    """

    def __init__(
        self,
        *,
        mask_signs: bool = False,
        perception: PerceptionLevel | None = None,
        heartbeat: Callable[[int], None] = _no_heartbeat,
        simulation: Simulation | None = None,
        loader: SceneLoader | None = None,
    ) -> None:
        self._mask, self._level = mask_signs, perception
        self._beat = heartbeat
        self.simulation = Simulation() if simulation is None else simulation
        self._loader = SceneLoader() if loader is None else loader
        self._catalog: Catalog = load_catalog()
        self.episode: Episode | None = None

    def prepare(self, spec: ScenarioSpec) -> None:
        """Load the roads of a row, unless they cannot be loaded."""
        self._beat(Phase.LOADING)
        with suppress(InputError):
            _ = self._loader.load(spec)[1].view

    def play(
        self, spec: ScenarioSpec, planner: str, privileged: bool = False, floor: bool = False
    ) -> Moments:
        """One episode. Never raises for what a scene or planner does: that becomes an error outcome with its cause.

        planner: its name in the result. privileged: is it told the rule? floor: is its seed the row's, not the pair's?
        """
        began = time.perf_counter()
        episode: Episode | None = None
        outcome, error, detail = Outcome.SIM_ERROR, "", ""
        try:
            self._beat(Phase.LOADING)
            scene, roads = self._loader.load(spec)
            self._catalog.check_plates(
                spec.sign_code, {s.id: s.code for s in scene.signs if s.role != DISTRACTOR}, spec.scenario_id
            )
            perception = None if self._level is None else (self._level, spec.pair_name)
            observer = Observer(scene, roads.view, self._mask, privileged, perception)
            episode = Episode(self.simulation, scene, roads, self._catalog, observer, self._beat)
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
            privilege = Privilege(sign, self._catalog.sign(sign.code).rule, scene.network, view)
        return PlannerContext(
            seed,
            view.map,
            view.graph,
            destination_on_map(view, scene),
            DT_S,
            privilege,
        )


class EpisodeRunner:
    """Runs episodes one after the other with one planner, made when the first begins. options: as `EpisodeLoop`'s.

    perception: the fields of a `PerceptionLevel`, as they travel to a worker.
    """

    def __init__(
        self,
        planner: LoadedPlanner,
        *,
        mask_signs: bool = False,
        perception: Mapping[str, Any] | None = None,
        heartbeat: Callable[[int], None] = _no_heartbeat,
        simulation: Simulation | None = None,
        loader: SceneLoader | None = None,
    ) -> None:
        self._loaded = planner
        self._planner: Planner | None = None
        self._loop = EpisodeLoop(
            mask_signs=mask_signs,
            perception=None if perception is None else from_plain(PerceptionLevel, perception),
            heartbeat=heartbeat,
            simulation=simulation,
            loader=loader,
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
        """One episode; of what its code raises, only KeyboardInterrupt is left to whoever runs the process."""
        loaded = self._loaded
        moments = self._loop.play(spec, loaded.name, loaded.privileged, loaded.floor)
        try:
            moment = next(moments)
            while True:
                try:
                    answer = self._answer(moment)
                except KeyboardInterrupt:
                    raise
                except BaseException as problem:
                    failure = PlannerFailure()
                    failure.__cause__ = problem
                    moment = moments.throw(failure)
                else:
                    moment = moments.send(answer)
        except StopIteration as end:
            result: EpisodeResult = end.value
            return result

    def _answer(self, moment: PlannerContext | Observation) -> Control | Trajectory | None:
        if isinstance(moment, PlannerContext):
            if self._planner is None:
                self._planner = self._loaded.factory()
            self._planner.reset(moment)
            return None
        assert self._planner is not None
        return self._planner.act(moment)

    def close(self) -> None:
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
        observer: Observer,
        beat: Callable[[int], None],
    ) -> None:
        self.sim, self.scene, self.roads, self._beat = sim, scene, roads, beat
        self.snapshots: list[WorldSnapshot] = []
        self.commands: list[tuple[float, float]] = []
        self.plans: list[Plan | None] = []
        self.planner_s: list[float] = []
        self.sim_s = 0.0
        self.monitors = make_monitors(catalog, scene)
        self.ending = TerminationCheck(scene, self.monitors.target)
        self.view = roads.view
        self.navigator = Navigator(self.view.graph, destination_on_map(self.view, scene))
        self.observer = observer
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
            if scene.walkers.come_up_s:
                self._walk(scene.walkers.speeds)
        # One more step brings the ego to its exact pose and fills the first view.
        sim.step()
        self.seen = ego_on_map(self.view, self.ego)
        self.route: RouteView = self.navigator.update(self.seen)
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

    def look(self) -> Observation:
        """What there is to see at the last tick."""
        return self.observer.observe(self.snapshots[-1], self.seen, self.route)

    def drive(self) -> Generator[Observation, Control | Trajectory | None, Outcome]:
        """The loop, until exactly one outcome."""
        clock = time.perf_counter
        beat = self._beat
        step = 0
        while True:
            snapshot = self.snapshots[-1]
            beat(Phase.SCORING)
            self.monitors.update(snapshot)
            ended = self.ending.at(snapshot)
            if ended is not None:
                return ended
            observation = self.look()
            beat(Phase.PLANNING)
            t0 = clock()
            output = yield observation
            t1 = clock()
            # What it returned is its own code still.
            command, self.intent = to_command(output, self.motion, self.view.map)
            plan = to_plan(output)
            beat(Phase.SIMULATING)
            self.planner_s.append(t1 - t0)
            self.commands.append(command)
            self.plans.append(plan)
            self.motion = advance(self.motion, *command)
            self.ego = self._locate(self.ego.lane)
            step += 1
            if not self._simulate(step):
                return Outcome.OFF_ROAD
            self.seen = ego_on_map(self.view, self.ego)
            self.route = self.navigator.update(self.seen)
            self.sim_s += clock() - t1

    def _simulate(self, step: int) -> bool:
        sim, ego = self.sim, self.ego
        if self.release is not None and self.release.update(ego):
            assert self.scene.convoy is not None
            for vehicle in self.scene.convoy.vehicles:
                sim.release(vehicle)
        plan = self.scene.walkers
        if plan is not None and step == round(plan.come_up_s / DT_S):
            self._walk((0.0,) * len(plan.persons))
        if plan is not None and self.walk is not None and self.walk.update(ego):
            self._walk(plan.speeds)
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

    def _walk(self, speeds: Sequence[float]) -> None:
        """All pedestrians of the scene's plan walk at these speeds from now."""
        assert self.scene.walkers is not None
        for person, speed in zip(self.scene.walkers.persons, speeds, strict=True):
            self.sim.let_walk(person, speed)

    def _show(self, edges: tuple[str, ...]) -> bool:
        try:
            return self.sim.set_route(self.view.sumo_edges(edges))
        except SimulationError as problem:
            if self.intent:
                raise PlannerOutputError(f"intent is no way through the network: {problem}") from problem
            raise

    def facts(self, outcome: Outcome) -> EpisodeFacts:
        return EpisodeFacts(
            scene=self.scene, snapshots=self.snapshots, route=self.route, start_remaining_m=self.start_remaining,
            outcome=outcome, contact=self.ending.contact, **self.monitors.finish()._asdict(),
        )  # fmt: skip
