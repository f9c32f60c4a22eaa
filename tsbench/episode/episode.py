"""The state of one episode, and its loop over ticks. The hot path of the product."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Sequence

from tsbench.core.errors import PlannerOutputError, SimulationError
from tsbench.episode.command import Plan, to_command, to_plan
from tsbench.episode.observation import Observer, destination_on_map, ego_on_map
from tsbench.episode.outcome import EpisodeFacts, Outcome, Phase, TerminationCheck
from tsbench.planners.base import Control, Observation, Trajectory
from tsbench.rules.monitors import make_monitors
from tsbench.scenarios.scene_loader import Roads
from tsbench.sim.convoy import ConvoyRelease
from tsbench.sim.ego import advance, start_motion
from tsbench.sim.junction_traffic import JunctionTraffic
from tsbench.sim.navigation import Navigator, RouteView
from tsbench.sim.scene import Scene
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S, EgoState, WorldSnapshot


class Episode:
    """The state of one episode in its loop."""

    def __init__(
        self,
        sim: Simulation,
        scene: Scene,
        roads: Roads,
        observer: Observer,
        beat: Callable[[int], None],
    ) -> None:
        self.sim, self.scene, self.roads, self._beat = sim, scene, roads, beat
        self.snapshots: list[WorldSnapshot] = []
        self.commands: list[tuple[float, float]] = []
        self.plans: list[Plan | None] = []
        self.planner_s: list[float] = []
        self.sim_s = 0.0
        self.monitors = make_monitors(scene)
        self.ending = TerminationCheck(scene, self.monitors.target)
        self.view = roads.view
        self.navigator = Navigator(self.view.graph, destination_on_map(self.view, scene))
        self.observer = observer
        self.walk = ConvoyRelease(scene.walkers, scene.network) if scene.walkers else None
        start = scene.network.lane(scene.start.lane)
        self.motion = start_motion(scene)
        self.ego = self._locate(start.index)
        self.traffic = JunctionTraffic(sim, scene)
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
        self.start_s = 0.0

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
            # Reading what the planner returned may still run code of the planner's.
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

    def facts(self, outcome: Outcome) -> EpisodeFacts:
        return EpisodeFacts(
            scene=self.scene, snapshots=self.snapshots, route=self.route, start_remaining_m=self.start_remaining,
            outcome=outcome, contact=self.ending.contact, **self.monitors.finish()._asdict(),
        )  # fmt: skip
