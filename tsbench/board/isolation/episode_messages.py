"""Contexts and observations as messages, both ways."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import msgspec

from tsbench.board.isolation import protocol
from tsbench.planners.base import Observation, PlannerContext, Privilege
from tsbench.roads.lane_graph import MapGraph, RoutePath
from tsbench.roads.network import RoadNetwork
from tsbench.roads.planner_map import PlannerMap, build_planner_map
from tsbench.roads.road_map import MapConnection, RoadMap
from tsbench.signs.annotations import plate_params
from tsbench.signs.catalog import load_catalog
from tsbench.sim.navigation import RouteView
from tsbench.sim.world import ActorKind, ActorTable


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
        told = protocol.ContextMessage(context.seed, context.destination, context.dt)
        if privilege is not None:
            sign, params = privilege.sign, privilege.sign.params
            sign, texts = replace(sign, params=None), {} if params is None else params.texts()
            told = protocol.ContextMessage(context.seed, context.destination, context.dt, sign, texts)
        return before + protocol.frame(told, self._encoder)

    def observation(self, o: Observation) -> bytes:
        route = o.route
        path = None if route.path is self._path else route.path
        self._path = route.path
        told = protocol.ObservationMessage(
            step=o.step,
            time=o.time,
            ego=o.ego,
            history=o.history,
            route=(route.s, route.d, route.remaining),
            path=path,
            actors=o.actors,
            signs=o.signs,
            obstacles=o.obstacles,
            truth=o.truth,
        )
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
            assert told.sign is not None
            catalog = load_catalog(mirrored=roads.left_hand)
            rule = catalog.sign(told.sign.code).rule
            sign = replace(told.sign, params=plate_params(rule.name, told.params, binds=False))
            privilege = Privilege(sign, catalog, roads, self._view)
            roads = self._view.map
        return PlannerContext(told.seed, roads, self._graph, told.destination, told.dt, privilege)

    def _observation(self, told: protocol.ObservationMessage) -> Observation:
        if told.path is not None:
            self._path = told.path
        assert self._path is not None
        return Observation(
            step=told.step,
            time=told.time,
            ego=told.ego,
            history=told.history,
            route=RouteView(self._path, *told.route),
            actors=told.actors,
            signs=told.signs,
            obstacles=told.obstacles,
            truth=told.truth,
        )

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
