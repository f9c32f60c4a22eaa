"""Contexts and observations as messages, both ways."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import partial
from operator import is_not
from typing import Any

from tsbench.planners.base import Observation, PlannerContext, Privilege, SignView
from tsbench.roads.destination import Destination
from tsbench.roads.lane_graph import MapGraph, RoutePath
from tsbench.roads.network import RoadNetwork
from tsbench.roads.planner_map import PlannerMap, build_planner_map
from tsbench.roads.road_map import RoadMap
from tsbench.run.isolation.maps import map_message, read_map, read_route, route_message
from tsbench.run.isolation.protocol import MessageKind, ProtocolError, lines, names, pack, unpack
from tsbench.run.isolation.ticks import read_tick, tick_message
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import load_catalog
from tsbench.signs.plate_params import PlateParams
from tsbench.sim.navigation import RouteView
from tsbench.sim.scene import Obstacle
from tsbench.sim.world import ActorKind, Actors, ActorTable, Agents, EgoState, WorldSnapshot


class Encoder:
    """The referee's side: what a planner is told; what stays the same is told once."""

    def __init__(self) -> None:
        self._map: RoadMap | None = None
        self._forget()

    def _forget(self) -> None:
        """What is told anew in each episode."""
        self._path: RoutePath | None = None
        self._same: tuple[Any, ...] = ()
        self._signs: list[tuple[Any, ...]] = []
        self._obstacles: tuple[Obstacle, ...] = ()
        self._told = 0

    def context(self, context: PlannerContext) -> bytes:
        privilege = context.privilege
        roads = context.network if privilege is None else privilege.network
        before = b"" if roads is self._map else map_message(roads)
        self._map = roads
        self._forget()
        return before + pack(
            MessageKind.CONTEXT, str(context.seed), context.destination.edge, (context.destination.s, context.dt),
            "" if privilege is None else json.dumps(_told_sign(privilege.sign)),
        )  # fmt: skip

    def observation(self, o: Observation) -> bytes:
        told = []
        if o.route.path is not self._path:
            self._path = o.route.path
            told.append(route_message(self._path))
        a = o.actors
        # The very arrays, as long as the same road users are in sight.
        same = (a.ids, a.kind, a.length, a.width)
        if len(self._same) != len(same) or any(map(is_not, same, self._same)):
            self._same = same
            told.append(pack(MessageKind.ACTORS, *same))
        signs = [
            (s.code, s.edge, s.outline, s.lane, s.main_road, s.value, s.x, s.y, s.heading, s.position_m)
            for s in o.signs
        ]
        if signs != self._signs:
            self._signs = signs
            told.append(_signs_message(signs))
        if o.obstacles != self._obstacles:
            self._obstacles = o.obstacles
            told.append(_obstacles_message(o.obstacles))
        if o.truth is not None:
            told.append(self._truth(o.truth))
        told.append(tick_message(o))
        return b"".join(told)

    def _truth(self, world: WorldSnapshot) -> bytes:
        actors, ego = world.actors, world.ego
        table = actors.table
        new = [
            (table.ids[i], int(table.kind[i]), float(table.length[i]), float(table.width[i]), table.routes[i])
            for i in range(self._told, len(table.ids))
        ]
        self._told = len(table.ids)
        return pack(
            MessageKind.TRUTH, (ego.lane,), (ego.s, ego.d), json.dumps(new) if new else "",
            actors.index, actors.pose, actors.speed, actors.lane, actors.lane_s,
        )  # fmt: skip


class Decoder:
    """The planner's side: what a Python planner is given, made from messages."""

    def __init__(self) -> None:
        self._map: RoadMap | None = None
        self._graph: MapGraph | None = None
        self._view: PlannerMap | None = None
        self._forget()

    def _forget(self) -> None:
        """As the referee's side: what is told anew in each episode."""
        self._path: RoutePath | None = None
        self._truth: list[Any] | None = None
        self._table = ActorTable()
        self._actors: list[Any] = []
        self._sizes: tuple[list[float], list[float]] = ([], [])
        self._signs: list[Callable[[float], SignView]] = []
        self._obstacles: tuple[Obstacle, ...] = ()

    def hear(self, kind: MessageKind, body: bytes) -> PlannerContext | Observation | None:
        """What a message is for the planner; None where another one has to follow."""
        if kind is MessageKind.OBSERVATION:
            return self._observation(body)
        if kind is MessageKind.TRUTH:
            self._truth = unpack(kind, body)
        elif kind is MessageKind.ACTORS:
            self._actors = unpack(kind, body)
            self._sizes = (self._actors[2].tolist(), self._actors[3].tolist())
        elif kind is MessageKind.SIGNS:
            self._signs = _read_signs(body)
        elif kind is MessageKind.OBSTACLES:
            self._obstacles = _read_obstacles(body)
        elif kind is MessageKind.ROUTE:
            self._path = read_route(body)
        elif kind is MessageKind.CONTEXT:
            return self._context(body)
        elif kind is MessageKind.MAP:
            self._map = read_map(body)
            self._view = build_planner_map(self._map) if isinstance(self._map, RoadNetwork) else None
            self._graph = MapGraph(self._map) if self._view is None else self._view.graph
        else:
            raise ProtocolError(f"{kind.name} is not for a planner")
        return None

    def _context(self, body: bytes) -> PlannerContext:
        seed, edge, (s, dt), sign = unpack(MessageKind.CONTEXT, body)
        assert self._map is not None
        assert self._graph is not None
        self._forget()
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
        numbers, lane, on_road, history, poses, speeds, lanes, indicators, distances = read_tick(body)
        step, time, x, y, heading, speed, acceleration, steering, yaw_rate, s, d, *route = numbers
        assert self._path is not None
        ego = EgoState(x, y, heading, speed, acceleration, steering, yaw_rate, lane, s, d, on_road)
        ids, kinds, lengths, widths = self._actors
        agents = Agents(
            ids, poses, speeds, lengths, widths, kinds, lanes, indicators,
            tuple(zip(*poses.T.tolist(), *self._sizes, strict=True)),
        )  # fmt: skip
        signs = [sign_at(away) for sign_at, away in zip(self._signs, distances, strict=True)]
        truth = None if self._truth is None else self._world(int(step), time, ego, self._truth)
        return Observation(
            int(step), time, ego, history, RouteView(self._path, *route), agents, tuple(signs),
            self._obstacles, truth,
        )  # fmt: skip

    def _world(self, step: int, time: float, seen: EgoState, told: list[Any]) -> WorldSnapshot:
        lane, place, new, index, poses, speeds, lanes, places = told
        for actor, kind, length, width, route in json.loads(new) if new else ():
            self._table.add(actor, ActorKind(kind), length, width, tuple(route))
        s, d = place.tolist()
        ego = EgoState(
            seen.x, seen.y, seen.heading, seen.speed, seen.acceleration, seen.steering, seen.yaw_rate, int(lane[0]),
            s, d, seen.on_road,
        )  # fmt: skip
        return WorldSnapshot(
            step, time, ego, Actors(self._table, index, poses.reshape(-1, 3), speeds, lanes, places)
        )


def _signs_message(signs: Sequence[tuple[Any, ...]]) -> bytes:
    return pack(
        MessageKind.SIGNS,
        lines([s[k] for k in range(3) for s in signs]),
        tuple(s[3] for s in signs),
        [
            (math.nan if value is None else value, *place, *(main_road or (math.nan, math.nan)))
            for _, _, _, _, main_road, value, *place in signs
        ],
    )


def _read_signs(body: bytes) -> list[Callable[[float], SignView]]:
    """What makes each sign of its distance."""
    words, lanes, numbers = unpack(MessageKind.SIGNS, body)
    m = len(lanes)
    told = names(words, 3 * m)
    rows = zip(
        told[:m], told[m : 2 * m], told[2 * m :], lanes.tolist(), numbers.reshape(m, 7).tolist(), strict=True
    )
    return [
        partial(
            SignView, code, None if math.isnan(value) else value, x, y, heading, edge, lane, s, outline=outline,
            main_road=() if math.isnan(main_road[0]) else tuple(main_road),
        )
        for code, edge, outline, lane, (value, x, y, heading, s, *main_road) in rows
    ]  # fmt: skip


def _obstacles_message(blocks: Sequence[Obstacle]) -> bytes:
    return pack(
        MessageKind.OBSTACLES, lines([*(b.id for b in blocks), *(b.shape for b in blocks), *(b.lane for b in blocks)]),
        [(b.x, b.y, b.heading, b.length, b.width) for b in blocks],
    )  # fmt: skip


def _read_obstacles(body: bytes) -> tuple[Obstacle, ...]:
    words, numbers = unpack(MessageKind.OBSTACLES, body)
    rows = numbers.reshape(-1, 5).tolist()
    k = len(rows)
    told = names(words, 3 * k)
    return tuple(
        Obstacle(told[i], told[k + i], x, y, heading, length, width, told[2 * k + i])
        for i, (x, y, heading, length, width) in enumerate(rows)
    )


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
