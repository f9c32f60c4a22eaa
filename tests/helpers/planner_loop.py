"""A closed loop without SUMO: bicycle, navigator, lane locator, and scripted road users."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tsbench.episode.observer import ego_on_map
from tsbench.episode.traffic_view import TrafficView
from tsbench.geometry.footprint import boxes_overlap
from tsbench.geometry.polyline import Polyline
from tsbench.planners.base import Control, Planner, PlannerContext, Privilege
from tsbench.planners.observation import Observation, SignView
from tsbench.roads.lane_graph import Destination, LaneGraph
from tsbench.roads.localization import LaneLocator
from tsbench.roads.network import RoadNetwork, read_network
from tsbench.roads.planner_map import build_planner_map
from tsbench.rules.monitor import Verdict
from tsbench.rules.monitors import make_monitor
from tsbench.signs.annotations import SignInstance, plate_params
from tsbench.signs.catalog import load_catalog
from tsbench.sim.ego import Motion, advance
from tsbench.sim.navigation import Navigator
from tsbench.sim.scene import EgoStart, Obstacle, Scene, SceneFile
from tsbench.sim.world import DT_S, EGO_LENGTH_M, EGO_WIDTH_M, ActorKind, Actors, ActorTable, EgoState, WorldSnapshot

KMH = 3.6


def target_plate(code: str, edge: str, value: float | None = None, at: float = 0.0, **params: str) -> SignInstance:
    """The plate that an expert is told, on all lanes of an edge, at an arc length in m."""
    told = plate_params(load_catalog().sign(code).rule.name, params)
    return SignInstance("sign_0", code, value, edge, -1, at, 0.0, 0.0, 0.0, "target", None, told)


DATA = Path(__file__).parents[1] / "planners" / "data"


def load(name: str) -> RoadNetwork:
    return read_network(DATA / f"{name}.net.xml")


@dataclass
class Body:
    """A road user on a chain of lanes, or on a track of its own; `speed(t, world)`: its speed, `front`: its place."""

    id: str
    lanes: tuple[str, ...]
    front: float
    speed: Callable[[float, World], float]
    route: tuple[str, ...] = ()
    kind: ActorKind = ActorKind.CAR
    length: float = 4.5
    width: float = 1.8
    now: float = 0.0
    track: Polyline | None = None


@dataclass
class World:
    """One episode: what stands still, who drives, and the record of the ego."""

    network: RoadNetwork
    start_lane: str
    start_s: float
    start_speed: float
    destination: Destination
    bodies: list[Body] = field(default_factory=list)
    obstacles: tuple[Obstacle, ...] = ()
    signs: tuple[SignView, ...] = ()
    target: SignInstance | None = None
    more_targets: tuple[SignInstance, ...] = ()
    time: float = 0.0
    states: list[EgoState] = field(default_factory=list)
    offsets: list[float] = field(default_factory=list)
    controls: list[Control] = field(default_factory=list)
    poses: list[dict[str, tuple[float, float, float]]] = field(default_factory=list)
    lateral: dict[str, float] = field(default_factory=dict)
    snapshots: list[WorldSnapshot] = field(default_factory=list)
    arrived: bool = False

    def __post_init__(self) -> None:
        self.view = build_planner_map(self.network)
        self.table = ActorTable()
        for body in self.bodies:
            self.table.add(body.id, body.kind, body.length, body.width, body.route)

    @property
    def ego(self) -> EgoState:
        return self.states[-1]

    def run(self, planner: Planner, seconds: float) -> World:
        """Drive until arrival or the end of the time."""
        view, locator = self.view, LaneLocator(self.network)
        destination = Destination(*view.on_edge(self.destination.edge, self.destination.s))
        navigator, traffic_view = Navigator(view.graph, destination), TrafficView(self.network, view)
        lane = self.network.lane(self.start_lane)
        x, y = lane.line.point_at(self.start_s)
        motion = Motion(x, y, lane.line.heading_at(self.start_s), self.start_speed)
        told = None
        if self.target is not None:
            told = Privilege((self.target, *self.more_targets), load_catalog(), self.network, view)
        planner.reset(PlannerContext(1, view.map, view.graph, destination, DT_S, told))
        last = lane.index
        for step in range(round(seconds / DT_S)):
            self.time = step * DT_S
            last, s, d, on_road = locator.locate(motion.x, motion.y, motion.heading, last)
            ego = EgoState(
                motion.x, motion.y, motion.heading, motion.speed, motion.acceleration, motion.steering,
                motion.yaw_rate, last, s, d, on_road,
            )  # fmt: skip
            self.states.append(ego)
            actors = self._actors()
            self.snapshots.append(WorldSnapshot(step, self.time, ego, actors))
            seen = ego_on_map(view, ego)
            route = navigator.update(seen)
            self.offsets.append(route.d)
            on_edge = last >= 0 and self.network.lanes[last].edge == self.destination.edge
            if on_edge and abs(s - self.destination.s) <= 5.0:
                self.arrived = True
                return self
            history = np.array([[ego.x, ego.y, ego.heading, ego.speed]])
            observation = Observation(
                step, self.time, seen, history, route, traffic_view.see(actors, ego), self.signs, self.obstacles,
                self.snapshots[-1] if told else None,
            )  # fmt: skip
            command = planner.act(observation)
            assert isinstance(command, Control)
            assert math.isfinite(command.acceleration)
            assert math.isfinite(command.steering)
            self.controls.append(command)
            motion = advance(motion, command.acceleration, command.steering)
        return self

    def _actors(self) -> Actors:
        rows, poses, lanes, places = [], [], [], []
        for body in sorted(self.bodies, key=lambda b: b.id):
            body.now = body.speed(self.time, self)
            body.front += body.now * DT_S
            index, line, s = self._place(body)
            heading = line.heading_at(s)
            px, py = line.point_at(s, self.lateral.get(body.id, 0.0))
            half = body.length / 2
            rows.append(self.table.rows[body.id])
            poses.append((px - half * math.cos(heading), py - half * math.sin(heading), heading))
            lanes.append(index)
            places.append(s)
        self.poses.append({self.table.ids[r]: p for r, p in zip(rows, poses, strict=True)})
        return Actors(
            self.table,
            np.array(rows, dtype=np.int32),
            np.array(poses, dtype=np.float64).reshape(-1, 3),
            np.array([b.now for b in sorted(self.bodies, key=lambda b: b.id)], dtype=np.float64),
            np.array(lanes, dtype=np.int32),
            np.array(places, dtype=np.float64),
        )

    def _place(self, body: Body) -> tuple[int, Polyline, float]:
        s = body.front
        if body.track is not None:
            return -1, body.track, s
        for lane_id in body.lanes:
            lane = self.network.lane(lane_id)
            if s <= lane.line.length or lane_id == body.lanes[-1]:
                return lane.index, lane.line, s
            s -= lane.line.length
        raise AssertionError


def constant(speed: float) -> Callable[[float, World], float]:
    return lambda _t, _w: speed


def cones(lane, s: float) -> tuple[Obstacle, ...]:
    """Four cones 1.5 m apart, centred on a lane at arc length s."""
    result = []
    for k in range(4):
        at = s + (k - 1.5) * 1.5
        x, y = lane.line.point_at(at)
        result.append(Obstacle(f"cone{k}", "cones", x, y, lane.line.heading_at(at), 0.4, 0.4, lane.id))
    return tuple(result)


def front_of(ego: EgoState) -> float:
    """Arc length of the ego's front on its lane."""
    return ego.s + EGO_LENGTH_M / 2


def ids(network: RoadNetwork, source: str, target: str) -> Sequence[str]:
    """Lane ids from an edge's lane 0 through the junction onto the next edge."""
    graph = LaneGraph(network)
    connection = graph.connections(source, target)[0]
    chain = (connection.from_lane, *connection.via, connection.to_lane)
    return [network.lanes[i].id for i in chain]


def car(network: RoadNetwork, source: str, target: str, before: float, speed: Callable[[float, World], float]) -> Body:
    """A car with its front `before` metres before its own line."""
    front = network.lane(f"{source}_0").line.length - before
    return Body(f"{source}{before:.0f}", tuple(ids(network, source, target)), front, speed, (source, target))


def to_line(world: World, lane: str = "sc_0") -> list[float]:
    """How far the ego's front was from the end of a lane, tick by tick."""
    line = world.network.lane(lane).line
    return [line.length - line.project(e.x, e.y)[0] - EGO_LENGTH_M / 2 for e in world.states]


def touched(world: World) -> bool:
    """Did the ego drive into a car?"""
    return any(
        boxes_overlap(e.x, e.y, e.heading, EGO_LENGTH_M, EGO_WIDTH_M, x, y, h, 4.5, 1.8)
        for e, poses in zip(world.states, world.poses, strict=False)
        for x, y, h in poses.values()
    )


def verdict(world: World) -> Verdict:
    """What the rule's own monitor says of a finished episode."""
    sign = world.target
    assert sign is not None
    scene = Scene(
        net=SceneFile(Path("test.net.xml"), b""), additional=SceneFile(Path("test.add.xml"), b""),
        network=world.network, signs=(sign,), targets=(sign.id,), obstacles=world.obstacles,
        start=EgoStart(world.start_lane, world.start_s, world.start_speed), destination=world.destination,
        horizon=600, seed=1, catalog=load_catalog(),
    )  # fmt: skip
    monitor = make_monitor(sign, scene)
    for snapshot in world.snapshots:
        monitor.update(snapshot)
    return monitor.finish()


def plate(code: str, value: float | None, x: float = 130.0) -> SignView:
    """A plate beside the long road, with all that it could be known by."""
    return SignView(code, value, x, -6.0, 0.0, "ab", 0, x, 60.0)


def long_road(*plates: SignView, speed: float = 50.0 / KMH, bodies: tuple[Body, ...] = ()) -> World:
    """The long road, the ego 50 m along it, its destination at 300 m."""
    return World(load("long"), "ab_0", 50.0, speed, Destination("ab", 300.0), list(bodies), signs=plates)
