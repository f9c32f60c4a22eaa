"""Contexts, observations and commands as messages, both ways."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from tsbench.core.errors import PlannerOutputError, cause_of
from tsbench.planners.base import Control, Observation, PlannerContext, Privilege, SignView, Trajectory
from tsbench.roads.destination import Destination
from tsbench.roads.lane_graph import MapGraph, RoutePath
from tsbench.roads.network import RoadNetwork
from tsbench.roads.road_map import RoadMap
from tsbench.roads.sealed import SealedRoads, seal
from tsbench.run.isolation.maps import fixed, map_message, read_map, read_route, route_message
from tsbench.run.isolation.protocol import Kind, ProtocolError, lines, names, pack, unpack
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import load_catalog
from tsbench.signs.plate_params import PlateParams
from tsbench.sim.ego import MAX_TRAJECTORY_POSES
from tsbench.sim.navigation import RouteView
from tsbench.sim.scene import Obstacle
from tsbench.sim.world import ActorKind, Actors, ActorTable, Agents, EgoState, WorldSnapshot

Output = Control | Trajectory


class Teller:
    """The referee's side: what a planner is told, each map and route once."""

    def __init__(self) -> None:
        self._map: RoadMap | None = None
        self._path: RoutePath | None = None
        self._told = 0

    def context(self, context: PlannerContext) -> bytes:
        privilege = context.privilege
        roads = context.network if privilege is None else privilege.network
        before = b"" if roads is self._map else map_message(roads)
        self._map, self._path, self._told = roads, None, 0
        return before + pack(
            Kind.CONTEXT, str(context.seed), context.destination.edge, (context.destination.s, context.dt),
            "" if privilege is None else json.dumps(_told_sign(privilege.sign)),
        )  # fmt: skip

    def observation(self, o: Observation) -> bytes:
        before = b""
        if o.route.path is not self._path:
            self._path = o.route.path
            before = route_message(self._path)
        if o.truth is not None:
            before += self._truth(o.truth)
        a, signs, blocks = o.actors, o.signs, o.obstacles
        return before + pack(
            Kind.OBSERVATION, (o.step, o.time), _ego(o.ego), (o.ego.lane, o.ego.on_road), o.history,
            (o.route.s, o.route.d, o.route.remaining),
            np.stack((a.ids, a.kind, a.lane, a.indicator), axis=1),
            np.column_stack((a.pose, a.speed, a.length, a.width)),
            lines([*(s.code for s in signs), *(s.edge for s in signs)]), [s.lane for s in signs],
            [(math.nan if s.value is None else s.value, s.x, s.y, s.heading, s.position_m, s.distance) for s in signs],
            lines([*(b.id for b in blocks), *(b.shape for b in blocks), *(b.lane for b in blocks)]),
            [(b.x, b.y, b.heading, b.length, b.width) for b in blocks],
        )  # fmt: skip

    def _truth(self, world: WorldSnapshot) -> bytes:
        actors = world.actors
        table = actors.table
        new = [
            (table.ids[i], int(table.kind[i]), float(table.length[i]), float(table.width[i]), table.routes[i])
            for i in range(self._told, len(table.ids))
        ]
        self._told = len(table.ids)
        return pack(
            Kind.TRUTH, (world.ego.lane, world.ego.on_road), _ego(world.ego), json.dumps(new) if new else "",
            np.stack((actors.index, actors.lane), axis=1),
            np.column_stack((actors.pose, actors.speed, actors.lane_s)),
        )  # fmt: skip


class Listener:
    """The planner's side: what a Python planner is given, made from messages."""

    def __init__(self) -> None:
        self._map: RoadMap | None = None
        self._graph: MapGraph | None = None
        self._view: SealedRoads | None = None
        self._path: RoutePath | None = None
        self._truth: list[Any] | None = None
        self._table = ActorTable()

    def hear(self, kind: Kind, body: bytes) -> PlannerContext | Observation | None:
        """What a message is for the planner; None where another one has to follow."""
        if kind is Kind.MAP:
            self._map = read_map(body)
            self._view = seal(self._map) if isinstance(self._map, RoadNetwork) else None
            self._graph = MapGraph(self._map) if self._view is None else self._view.graph
        elif kind is Kind.CONTEXT:
            return self._context(body)
        elif kind is Kind.ROUTE:
            self._path = read_route(body)
        elif kind is Kind.TRUTH:
            self._truth = unpack(kind, body)
        elif kind is Kind.OBSERVATION:
            return self._observation(body)
        else:
            raise ProtocolError(f"{kind.name} is not for a planner")
        return None

    def _context(self, body: bytes) -> PlannerContext:
        seed, edge, (s, dt), sign = unpack(Kind.CONTEXT, body)
        assert self._map is not None
        assert self._graph is not None
        self._path, self._truth, self._table = None, None, ActorTable()
        roads, privilege = self._map, None
        if self._view is not None:
            assert isinstance(roads, RoadNetwork)
            target = _sign(json.loads(sign))
            privilege = Privilege(target, load_catalog().sign(target.code).rule, roads, self._view)
            roads = self._view.map
        return PlannerContext(
            int(seed), roads, self._graph, Destination(edge, float(s)), float(dt), privilege
        )

    def _observation(self, body: bytes) -> Observation:
        (
            (step, time), ego, ego_lane, history, (s, d, remaining), words, numbers, sign_names, sign_lanes, signs,
            obstacle_names, obstacles,
        ) = unpack(Kind.OBSERVATION, body)  # fmt: skip
        assert self._path is not None
        truth = None if self._truth is None else self._world(int(step), float(time), self._truth)
        return Observation(
            int(step), float(time), _read_ego(ego, ego_lane), history.reshape(-1, 4),
            RouteView(self._path, float(s), float(d), float(remaining)), _agents(words, numbers),
            tuple(_signs(sign_names, sign_lanes, signs)) if len(sign_lanes) else (),
            tuple(_obstacles(obstacle_names, obstacles)) if len(obstacles) else (), truth,
        )  # fmt: skip

    def _world(self, step: int, time: float, told: list[Any]) -> WorldSnapshot:
        lane, ego, new, index, numbers = told
        for actor, kind, length, width, route in json.loads(new) if new else ():
            self._table.add(actor, ActorKind(kind), length, width, tuple(route))
        rows, each = index.reshape(-1, 2), numbers.reshape(-1, 5)
        actors = Actors(
            self._table, fixed(rows[:, 0]), fixed(each[:, :3]), fixed(each[:, 3]), fixed(rows[:, 1]), fixed(each[:, 4])
        )  # fmt: skip
        return WorldSnapshot(step, time, _read_ego(ego, lane), actors)


def _ego(ego: EgoState) -> tuple[float, ...]:
    return (
        ego.x, ego.y, ego.heading, ego.speed, ego.acceleration, ego.steering, ego.yaw_rate, ego.s, ego.d
    )  # fmt: skip


def _read_ego(numbers: Any, lane: Any) -> EgoState:
    x, y, heading, speed, acceleration, steering, yaw_rate, s, d = numbers.tolist()
    at, on_road = lane.tolist()
    return EgoState(x, y, heading, speed, acceleration, steering, yaw_rate, at, s, d, bool(on_road))


def _agents(words: Any, numbers: Any) -> Agents:
    whole, real = words.reshape(-1, 4), numbers.reshape(-1, 6)
    boxes = tuple((x, y, h, length, width) for x, y, h, _, length, width in real.tolist())
    small = whole.astype(np.int8)
    return Agents(
        fixed(whole[:, 0]), fixed(real[:, :3]), fixed(real[:, 3]), fixed(real[:, 4]), fixed(real[:, 5]),
        fixed(small[:, 1]), fixed(whole[:, 2]), fixed(small[:, 3]), boxes,
    )  # fmt: skip


def _signs(words: str, lanes: Any, numbers: Any) -> Iterator[SignView]:
    m = len(lanes)
    told = names(words, 2 * m)
    for i, (value, x, y, heading, s, distance) in enumerate(numbers.reshape(m, 6).tolist()):
        yield SignView(
            told[i], None if math.isnan(value) else value, x, y, heading, told[m + i], int(lanes[i]), s, distance
        )  # fmt: skip


def _obstacles(words: str, numbers: Any) -> Iterator[Obstacle]:
    rows = numbers.reshape(-1, 5).tolist()
    k = len(rows)
    told = names(words, 3 * k)
    for i, (x, y, heading, length, width) in enumerate(rows):
        yield Obstacle(told[i], told[k + i], x, y, heading, length, width, told[2 * k + i])


def _told_sign(sign: SignInstance) -> dict[str, Any]:
    return {**asdict(sign), "params_kind": None if sign.params is None else type(sign.params).__name__}


def _sign(told: dict[str, Any]) -> SignInstance:
    kind, params = told.pop("params_kind"), told.pop("params")
    if kind is None:
        return SignInstance(**told)
    kinds = {one.__name__: one for one in _below(PlateParams)}
    own = {name: tuple(value) if isinstance(value, list) else value for name, value in params.items()}
    return SignInstance(**told, params=kinds[kind](**own))


def _below(kind: type[PlateParams]) -> Iterator[type[PlateParams]]:
    for one in kind.__subclasses__():
        yield one
        yield from _below(one)


def command_message(output: object) -> bytes:
    """What a planner returned, or that it is no command."""
    try:
        if isinstance(output, Control):
            # A number of the planner's own making may raise what it likes.
            numbers = (_number(output.acceleration), _number(output.steering))
            plan = output.plan
            return pack(
                Kind.CONTROL, numbers, _intent(output.intent), (plan is not None,),
                () if plan is None else _array("Control.plan", plan, 2),
            )  # fmt: skip
        if isinstance(output, Trajectory):
            times, poses = output.times, output.poses
            single = [getattr(part, "dtype", None) == np.float32 for part in (times, poses)]
            return pack(
                Kind.TRAJECTORY, single, _array("Trajectory.times", times, 1), _array("Trajectory.poses", poses, 3),
                _intent(output.intent),
            )  # fmt: skip
    except KeyboardInterrupt:
        raise
    except BaseException as problem:
        return pack(Kind.INVALID, f"{type(output).__name__} cannot be read ({cause_of(problem)})"[:500])
    return pack(Kind.INVALID, f"act returned {type(output).__name__}, expected Control or Trajectory"[:500])


def read_command(kind: Kind, body: bytes) -> Output:
    """The command of a message. Raises PlannerOutputError or ProtocolError."""
    if kind is Kind.CONTROL:
        numbers, intent, has_plan, plan = unpack(kind, body)
        if len(numbers) != 2 or len(has_plan) != 1 or len(plan) % 2:
            raise ProtocolError("CONTROL: not two numbers and a plan of pairs")
        points = fixed(plan.reshape(-1, 2)) if has_plan[0] else None
        return Control(float(numbers[0]), float(numbers[1]), _edges(intent), points)
    if kind is Kind.TRAJECTORY:
        single, times, poses, intent = unpack(kind, body)
        if len(single) != 2 or len(poses) != 3 * len(times):
            raise ProtocolError("TRAJECTORY: not three numbers for each time")
        dtypes = [np.float32 if one else np.float64 for one in single]
        return Trajectory(times.astype(dtypes[0]), poses.reshape(-1, 3).astype(dtypes[1]), _edges(intent))
    if kind is Kind.INVALID:
        raise PlannerOutputError(unpack(kind, body)[0][:500])
    raise ProtocolError(f"{kind.name} is no answer to an observation")


def _number(value: object) -> float:
    # Text and complex numbers have no __float__.
    if not hasattr(type(value), "__float__"):
        raise PlannerOutputError(f"holds {type(value).__name__}, expected a number")
    return float(value)  # type: ignore[arg-type]


def _array(name: str, value: Any, width: int) -> Any:
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiu":
        raise PlannerOutputError(f"{name} is {type(value).__name__}, expected a NumPy array of numbers")
    good = value.ndim == 1 if width == 1 else value.ndim == 2 and value.shape[1] == width
    if not good or len(value) > MAX_TRAJECTORY_POSES:
        raise PlannerOutputError(
            f"{name} has shape {value.shape}, expected at most {MAX_TRAJECTORY_POSES} rows"
        )
    return value


def _intent(edges: Sequence[str]) -> str:
    if not isinstance(edges, tuple) or any(not isinstance(edge, str) or "\n" in edge for edge in edges):
        raise PlannerOutputError("intent is no tuple of edge ids")
    return lines(edges)


def _edges(text: str) -> tuple[str, ...]:
    return tuple(text.split("\n")) if text else ()
