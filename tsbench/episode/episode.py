"""One episode, from a scenario's row to its verdicts. The hot path of the product."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass

import numpy as np

from tsbench.core.errors import InputError, PlannerOutputError, SimulationError, cause_in_planner, cause_of
from tsbench.core.seeds import floor_seed, planner_seed
from tsbench.episode.observer import Observer, destination_on_map, ego_on_map
from tsbench.episode.outcome import EpisodeFacts, EpisodeResult, Outcome, Phase, TerminationCheck
from tsbench.episode.perception_level import EXACTLY, Perception
from tsbench.planners.base import Control, Plan, PlannerContext, Privilege, Trajectory, to_command, to_plan
from tsbench.planners.observation import Observation
from tsbench.rules.monitors import make_monitors
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import Roads, SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.convoy import ConvoyRelease
from tsbench.sim.ego import advance, start_motion
from tsbench.sim.junction_traffic import JunctionTraffic
from tsbench.sim.navigation import Navigator, RouteView
from tsbench.sim.scene import Scene
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S, EgoState, WorldSnapshot

_MOST_ERROR = 500


@dataclass(frozen=True, slots=True)
class Judged:
    """Clauses violated so far, once per event; an excursion that goes on counts.

    targets, others: of the target signs' rules and of the other signs'. engaged: do the targets' rules apply?
    """

    targets: tuple[str, ...]
    others: tuple[str, ...]
    needless: tuple[str, ...]
    wrong_way: tuple[str, ...]
    _: KW_ONLY
    engaged: bool

    @property
    def violations(self) -> tuple[str, ...]:
        """All but needless obedience."""
        return (*self.targets, *self.others, *self.wrong_way)

    @property
    def against(self) -> tuple[str, ...]:
        """What counts against SCD."""
        return (*self.targets, *self.needless, *self.wrong_way)


def no_heartbeat(_: int) -> None:
    """For episodes that no watchdog follows."""


class Episode:
    """One episode, driven by its caller:

        episode = Episode(row)
        planner.reset(episode.context)
        while episode.result is None:
            episode.step(planner.act(episode.observation))

    Nothing that a scene does wrong is raised: it ends the episode with an error outcome, at once (then `context` is
    missing) or at a later tick. A process has one episode at a time: another one takes SUMO away from this.

    planner: its name in the result. privileged: is it told the rule? floor: is its seed the row's, not the pair's?
    heartbeat: called with a `Phase` at each change, so that a watchdog knows what is late. simulation, loader: those of
    this process, if they exist already.
    """

    context: PlannerContext

    def __init__(
        self,
        spec: ScenarioSpec,
        *,
        planner: str = "env",
        privileged: bool = False,
        floor: bool = False,
        perception: Perception = EXACTLY,
        heartbeat: Callable[[int], None] = no_heartbeat,
        simulation: Simulation | None = None,
        loader: SceneLoader | None = None,
    ) -> None:
        self._began = self._asked = time.perf_counter()
        self.spec, self.planner, self._beat = spec, planner, heartbeat
        self.sim = Simulation() if simulation is None else simulation
        self.result: EpisodeResult | None = None
        self.snapshots: list[WorldSnapshot] = []
        self.commands: list[tuple[float, float]] = []
        self.plans: list[Plan | None] = []
        self._planner_s: list[float] = []
        self._start_s = self._sim_s = 0.0
        self._is_loaded = False
        try:
            heartbeat(Phase.LOADING)
            scene, roads = (SceneLoader(DataSet()) if loader is None else loader).load(spec)
            scene.check_codes(spec.sign_code, spec.scenario_id)
            self.observer = Observer(scene, roads.view, perception, spec.pair_name, privileged)
            self._load(scene, roads)
            seed = floor_seed(spec.scenario_id) if floor else planner_seed(spec.pair_name)
            self.context = _context(seed, scene, roads, privileged)
            self._judge()
        except Exception as problem:
            self._break_off(problem)

    def _load(self, scene: Scene, roads: Roads) -> None:
        """Bring SUMO to the first tick, with the ego in its exact pose."""
        sim, self.scene, self.roads = self.sim, scene, roads
        self.monitors = make_monitors(scene)
        self.ending = TerminationCheck(scene, self.monitors.targets)
        self.view = roads.view
        self.navigator = Navigator(self.view.graph, destination_on_map(self.view, scene))
        self.walk = ConvoyRelease(scene.walkers, scene.network) if scene.walkers else None
        start = scene.network.lane(scene.start.lane)
        self.motion = start_motion(scene)
        self.ego = self._locate(start.index)
        self.traffic = JunctionTraffic(sim, scene)
        self._table = sim.table
        sim.start_ego(self.motion, start.edge, start.order)
        self.traffic.begin()
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
        self._sumo_route: tuple[str, ...] = ()
        self._sumo_route_lane = -1
        self._record_snapshot(0)
        self._is_loaded = True

    @property
    def observation(self) -> Observation:
        """What the planner is shown at this tick; its time counts from here."""
        self._beat(Phase.PLANNING)
        self._asked = time.perf_counter()
        return self._shown

    @property
    def is_current(self) -> bool:
        """Does SUMO hold this episode's scene, and no later one's?"""
        return self._is_loaded and self.sim.holds(self._table)

    def step(self, answer: Control | Trajectory) -> None:
        """One tick with what the planner answered; `result` is there once the episode is over."""
        t1 = time.perf_counter()
        try:
            # Reading what the planner returned may still run code of the planner's.
            command, self.intent = to_command(answer, self.motion, self.view.map)
            plan = to_plan(answer)
            self._beat(Phase.SIMULATING)
            if not self.commands:
                self._start_s = self._asked - self._began
            self._planner_s.append(t1 - self._asked)
            self.commands.append(command)
            self.plans.append(plan)
            self.motion = advance(self.motion, *command)
            self.ego = self._locate(self.ego.lane)
            if not self._simulate(len(self.commands)):
                self._end(Outcome.OFF_ROAD)
                return
            self.seen = ego_on_map(self.view, self.ego)
            self.route = self.navigator.update(self.seen)
            self._sim_s += time.perf_counter() - t1
            self._judge()
        except Exception as problem:
            self._break_off(problem)

    def _judge(self) -> None:
        """The verdicts at the last tick; then what there is to see at it, unless it ends the episode."""
        snapshot = self.snapshots[-1]
        self._beat(Phase.SCORING)
        self.monitors.update(snapshot)
        ended = self.ending.at(snapshot)
        if ended is not None:
            self._end(ended)
        else:
            self._shown = self.look()

    def look(self) -> Observation:
        """What there is to see at the last tick, also at the one that ended the episode, which no planner is shown."""
        return self.observer.observe(self.snapshots[-1], self.seen, self.route)

    def fail(self, problem: BaseException) -> None:
        """End the episode by what the planner raised, whatever it is."""
        detail = "".join(traceback.format_exception(problem))
        self._end(Outcome.PLANNER_ERROR, cause_in_planner(problem)[:_MOST_ERROR], detail)

    def _break_off(self, problem: Exception) -> None:
        if isinstance(problem, PlannerOutputError):
            self._end(Outcome.INVALID_OUTPUT, _line(problem))
        else:
            # A defect of ours (a monitor, say) is an episode error with its traceback, never "no violation".
            ours = "" if isinstance(problem, (InputError, SimulationError)) else "internal error: "
            self._end(Outcome.SIM_ERROR, ours + _line(problem), traceback.format_exc())

    def _end(self, outcome: Outcome, error: str = "", detail: str = "") -> None:
        facts = None
        if self._is_loaded:
            try:
                facts = self._facts(outcome)
            except Exception as problem:
                outcome, error = Outcome.SIM_ERROR, f"internal error: {_line(problem)}"
                detail += traceback.format_exc()
        self._beat(Phase.IDLE)
        self.result = EpisodeResult(
            spec=self.spec,
            planner=self.planner,
            outcome=outcome,
            error=error,
            detail=detail,
            facts=facts,
            commands=np.array(self.commands, dtype=np.float64).reshape(-1, 2),
            planner_s=np.array(self._planner_s, dtype=np.float64),
            start_s=self._start_s,
            sim_s=self._sim_s,
            total_s=time.perf_counter() - self._began,
            plans=tuple(self.plans),
            told=self.observer.told if self._is_loaded else (),
        )

    def _facts(self, outcome: Outcome) -> EpisodeFacts:
        return EpisodeFacts(
            scene=self.scene,
            snapshots=self.snapshots,
            route=self.route,
            start_remaining_m=self.start_remaining,
            outcome=outcome,
            contact=self.ending.contact,
            verdicts=self.monitors.finish(),
        )

    def judged(self) -> Judged:
        """What the monitors say so far, or said in the end."""
        m = self.monitors
        groups = (m.targets, m.others, m.needless, (m.wrong_way,))
        clauses = [tuple(clause for one in group for clause in one.clauses()) for group in groups]
        return Judged(*clauses, engaged=all(one.engaged for one in m.targets))

    def _locate(self, last: int) -> EgoState:
        m = self.motion
        lane, s, d, on_road = self.roads.locator.locate(m.x, m.y, m.heading, last)
        return EgoState(
            x=m.x, y=m.y, heading=m.heading, speed=m.speed, acceleration=m.acceleration, steering=m.steering,
            yaw_rate=m.yaw_rate, lane=lane, s=s, d=d, on_road=on_road,
        )  # fmt: skip

    def _record_snapshot(self, step: int) -> bool:
        """Read the world after a step; False if the ego has left the map."""
        actors = self.sim.actors()
        if actors is None:
            return False
        self.snapshots.append(WorldSnapshot(step, step * DT_S, self.ego, actors))
        return True

    def _simulate(self, step: int) -> bool:
        sim, ego = self.sim, self.ego
        self.traffic.update(ego)
        plan = self.scene.walkers
        if plan is not None and step == round(plan.come_up_s / DT_S):
            self._walk((0.0,) * len(plan.persons))
        if plan is not None and self.walk is not None and self.walk.update(ego):
            self._walk(plan.speeds)
        wanted = self.intent or self.route.path.edges
        if ego.lane != self._sumo_route_lane:
            # Inside a junction SUMO may take the ego for another path's, and forgets its way for that one's.
            self._sumo_route, self._sumo_route_lane = (), ego.lane
        if wanted is not self._sumo_route and (wanted == self._sumo_route or self._set_sumo_route(wanted)):
            self._sumo_route = wanted
        if ego.lane >= 0:
            lane = self.scene.network.lanes[ego.lane]
            sim.place_ego(self.motion, lane.edge, lane.order)
        else:
            sim.place_ego(self.motion, "", -1)
        sim.step()
        return self._record_snapshot(step)

    def _walk(self, speeds: Sequence[float]) -> None:
        """All pedestrians of the scene's plan walk at these speeds from now."""
        assert self.scene.walkers is not None
        for person, speed in zip(self.scene.walkers.persons, speeds, strict=True):
            self.sim.let_walk(person, speed)

    def _set_sumo_route(self, edges: tuple[str, ...]) -> bool:
        try:
            return self.sim.set_route(self.view.sumo_edges(edges))
        except SimulationError as problem:
            if self.intent:
                raise PlannerOutputError(f"intent is no way through the network: {problem}") from problem
            raise


def _context(seed: int, scene: Scene, roads: Roads, privileged: bool) -> PlannerContext:
    view, privilege = roads.view, None
    if privileged:
        privilege = Privilege(scene.target_signs, scene.catalog, scene.network, view)
    return PlannerContext(seed, view.map, view.graph, destination_on_map(view, scene), DT_S, privilege)


def _line(error: BaseException) -> str:
    return cause_of(error)[:_MOST_ERROR]
