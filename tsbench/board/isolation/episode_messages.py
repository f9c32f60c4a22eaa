"""Contexts and observations as messages, both ways.

Commands as messages, both ways.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, replace
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np

from tsbench.board.isolation import protocol
from tsbench.board.isolation.protocol import ProtocolError
from tsbench.core.errors import PlannerOutputError, cause_of
from tsbench.core.text import written_out
from tsbench.planners.base import Control, PlannerContext, Privilege, Trajectory
from tsbench.planners.observation import Observation
from tsbench.roads.lane_graph import MapGraph, RoutePath
from tsbench.roads.network import RoadNetwork
from tsbench.roads.planner_map import PlannerMap, build_planner_map
from tsbench.roads.road_map import MapConnection, RoadMap
from tsbench.signs.annotations import plate_params
from tsbench.signs.catalog import load_catalog
from tsbench.sim.ego import MAX_TRAJECTORY_POSES
from tsbench.sim.navigation import RouteView
from tsbench.sim.world import ActorKind, ActorTable

# Fields of an observation that are told as they are.
_ALIKE = tuple(field.name for field in fields(Observation) if field.name != "route")


class Encoder:
    """The referee's side: what a planner is told; maps, routes and what road users are like are told once."""

    def __init__(self) -> None:
        self._encoder = msgspec.msgpack.Encoder(enc_hook=self._plain)
        self._map: RoadMap | None = None
        self._path: RoutePath | None = None
        self._told = 0

    def context(self, context: PlannerContext) -> bytes:
        privilege = context.privilege
        roads = context.network if privilege is None else privilege.network
        before = b"" if roads is self._map else protocol.frame(_map_message(roads), self._encoder)
        self._map, self._path, self._told = roads, None, 0
        targets = () if privilege is None else privilege.signs
        signs = tuple(replace(sign, params=None) for sign in targets)
        texts = tuple({} if sign.params is None else sign.params.texts() for sign in targets)
        told = protocol.ContextMessage(context.seed, context.destination, context.dt, signs, texts)
        return before + protocol.frame(told, self._encoder)

    def observation(self, o: Observation) -> bytes:
        route = o.route
        path = None if route.path is self._path else route.path
        self._path = route.path
        same = {name: getattr(o, name) for name in _ALIKE}
        told = protocol.ObservationMessage(**same, route=(route.s, route.d, route.remaining), path=path)
        return protocol.frame(told, self._encoder)

    def _plain(self, value: Any) -> Any:
        if type(value) is not ActorTable:
            return protocol.plain(value)
        begin, self._told = self._told, len(value.ids)
        rows = range(begin, self._told)
        return [(value.ids[i], value.kind[i], value.length[i], value.width[i], value.routes[i]) for i in rows]


class Decoder:
    """The planner's side: what a Python planner is given, made from messages."""

    def __init__(self) -> None:
        self._decoder = msgspec.msgpack.Decoder(protocol.Asked, dec_hook=self._rich)
        self._map: RoadMap | None = None
        self._graph: MapGraph | None = None
        self._view: PlannerMap | None = None
        self._path: RoutePath | None = None
        self._table = ActorTable()

    def read(self, body: bytes) -> protocol.Asked:
        told: protocol.Asked = self._decoder.decode(body)
        return told

    def hear(self, told: protocol.Asked) -> PlannerContext | Observation | None:
        """What a message is for the planner; None where another one has to follow."""
        if isinstance(told, protocol.ObservationMessage):
            return self._observation(told)
        if isinstance(told, protocol.ContextMessage):
            return self._context(told)
        if not isinstance(told, protocol.EndMessage):
            self._map = _roads(told)
            self._view = build_planner_map(self._map) if isinstance(self._map, RoadNetwork) else None
            self._graph = MapGraph(self._map) if self._view is None else self._view.graph
        return None

    def _context(self, told: protocol.ContextMessage) -> PlannerContext:
        assert self._map is not None
        assert self._graph is not None
        self._path, self._table = None, ActorTable()
        roads, privilege = self._map, None
        if self._view is not None:
            assert isinstance(roads, RoadNetwork)
            catalog = load_catalog(mirrored=roads.left_hand)
            signs = tuple(
                replace(sign, params=plate_params(catalog.sign(sign.code).rule.name, params, binds=False))
                for sign, params in zip(told.signs, told.params, strict=True)
            )
            privilege = Privilege(signs, catalog, roads, self._view)
            roads = self._view.map
        return PlannerContext(told.seed, roads, self._graph, told.destination, told.dt, privilege)

    def _observation(self, told: protocol.ObservationMessage) -> Observation:
        if told.path is not None:
            self._path = told.path
        assert self._path is not None
        same = {name: getattr(told, name) for name in _ALIKE}
        return Observation(**same, route=RouteView(self._path, *told.route))

    def _rich(self, kind: Any, told: Any) -> Any:
        if kind is not ActorTable:
            return protocol.rich(kind, told)
        for actor, number, length, width, route in told:
            self._table.add(actor, ActorKind(number), length, width, tuple(route))
        return self._table


def _map_message(roads: RoadMap) -> protocol.MapMessage | protocol.NetworkMessage:
    parts: dict[str, Any] = {
        "lanes": roads.lanes,
        "edges": tuple(roads.edges.values()),
        "connections": roads.connections,
        "junctions": tuple(roads.junctions.values()),
        "crossings": tuple(roads.crossings.values()),
        "left_hand": roads.left_hand,
    }
    if isinstance(roads, RoadNetwork):
        return protocol.NetworkMessage(**parts, class_speed=dict(roads.class_speed))
    return protocol.MapMessage(**parts)


def _roads(told: protocol.MapMessage | protocol.NetworkMessage) -> RoadMap:
    outgoing: list[list[MapConnection]] = [[] for _ in told.lanes]
    for connection in told.connections:
        outgoing[connection.from_lane].append(connection)
    parts: dict[str, Any] = {
        "lanes": told.lanes,
        "lane_index": MappingProxyType({lane.id: lane.index for lane in told.lanes}),
        "edges": _by_id(told.edges),
        "junctions": _by_id(told.junctions),
        "connections": told.connections,
        "outgoing": tuple(map(tuple, outgoing)),
        "crossings": _by_id(told.crossings),
        "left_hand": told.left_hand,
    }
    if isinstance(told, protocol.NetworkMessage):
        return RoadNetwork(**parts, class_speed=told.class_speed)
    return RoadMap(**parts)


def _by_id(parts: Iterable[Any]) -> MappingProxyType[str, Any]:
    return MappingProxyType({part.id: part for part in parts})


def command_message(output: object) -> bytes:
    """What a planner returned, or that it is no command."""
    try:
        if isinstance(output, Control):
            # A number of the planner's own making may raise what it likes.
            numbers = (_number(output.acceleration), _number(output.steering))
            plan = None if output.plan is None else _floats("Control.plan", output.plan, 2)
            return protocol.frame(protocol.ControlMessage(*numbers, _intent(output.intent), plan))
        if isinstance(output, Trajectory):
            times, poses = output.times, output.poses
            return protocol.frame(
                protocol.TrajectoryMessage(
                    _floats("Trajectory.times", times, 1), _floats("Trajectory.poses", poses, 3), _intent(output.intent)
                )
            )
    except KeyboardInterrupt:
        raise
    except BaseException as problem:
        reason = f"{type(output).__name__} cannot be read ({cause_of(problem)})"
    else:
        reason = f"act returned {type(output).__name__}, expected Control or Trajectory"
    return protocol.frame(protocol.InvalidMessage(written_out(reason)[:500]))


def read_command(answer: protocol.Answer) -> Control | Trajectory:
    """The command of a message. Raises PlannerOutputError or ProtocolError."""
    if isinstance(answer, protocol.ControlMessage):
        plan = None if answer.plan is None else answer.plan.array()
        return Control(answer.acceleration, answer.steering, answer.intent, plan)
    if isinstance(answer, protocol.TrajectoryMessage):
        return Trajectory(answer.times.array(), answer.poses.array(), answer.intent)
    if isinstance(answer, protocol.InvalidMessage):
        raise PlannerOutputError(answer.reason[:500])
    raise ProtocolError(f"{type(answer).__name__} is no answer to an observation")


def _number(value: object) -> float:
    # Text and complex numbers have no __float__.
    if not hasattr(type(value), "__float__"):
        raise PlannerOutputError(f"holds {type(value).__name__}, expected a number")
    return float(value)  # type: ignore[arg-type]


def _floats(name: str, value: Any, width: int) -> protocol.Floats:
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiu":
        raise PlannerOutputError(f"{name} is {type(value).__name__}, expected a NumPy array of numbers")
    good = value.ndim == 1 if width == 1 else value.ndim == 2 and value.shape[1] == width
    if not good or len(value) > MAX_TRAJECTORY_POSES:
        raise PlannerOutputError(f"{name} has shape {value.shape}, expected at most {MAX_TRAJECTORY_POSES} rows")
    single = value.dtype == np.float32
    return protocol.Floats(
        "<f4" if single else "<f8", value.shape, np.asarray(value, "<f4" if single else "<f8").tobytes()
    )


def _intent(edges: object) -> tuple[str, ...]:
    if not isinstance(edges, tuple) or not all(isinstance(edge, str) for edge in edges):
        raise PlannerOutputError("intent is no tuple of edge ids")
    return tuple(map(str.__str__, edges))
