"""A scene on its roads, and its road users at the start and at a tick, as shapes, lowest first. Units: m, rad.

`rule_zone` is the ground that the target's rule is about, from the parameters of its plate. `indicators` and `braking`
are the lights of vehicles, tick by tick.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import shapely
from lxml import etree

from tsbench.core.benchmark import ARRIVAL_M
from tsbench.episode.traffic_view import TrafficView
from tsbench.geometry.footprint import corners
from tsbench.geometry.overlap import strip
from tsbench.geometry.polyline import Array
from tsbench.report.drawing.canvas import Area, Body, DrawnPlate, Line, Shape, dashes, rounded
from tsbench.report.drawing.road_shapes import mark_shapes
from tsbench.roads.lane_graph import LaneGraph
from tsbench.roads.network import Lane, RoadNetwork
from tsbench.rules.monitor import Violation
from tsbench.signs.annotations import SignInstance
from tsbench.signs.countries import Country
from tsbench.signs.rule_kinds import (
    ApproachParams,
    CrosswalkParams,
    JunctionParams,
    ObstacleParams,
    ReservedLaneParams,
    RoundaboutParams,
    ZoneParams,
)
from tsbench.sim.main_road import main_roads
from tsbench.sim.scene import Scene
from tsbench.sim.scene_file import EGO_ID, read_additional
from tsbench.sim.world import DT_S, EGO_LENGTH_M, EGO_WIDTH_M, ActorKind, ActorTable, Indicator, WorldSnapshot

# A vehicle that slows down by more is braking.
_BRAKES_MPS2 = 0.8
_SIDES = MappingProxyType({Indicator.NONE: 0, Indicator.LEFT: 1, Indicator.RIGHT: -1})


def indicators(traffic_view: TrafficView, snapshot: WorldSnapshot) -> list[int]:
    """(n,) of others in their order: 1 = the left side flashes, -1 = the right side. Ticks must come in order."""
    seen = traffic_view.see(snapshot.actors, snapshot.ego)
    # The view has an order of its own: its road users are found again by where they are.
    sides = {(x, y): _SIDES[i] for (x, y, _), i in zip(seen.pose.tolist(), seen.indicator.tolist(), strict=True)}
    return [sides.get((x, y), 0) for x, y, _ in snapshot.actors.pose.tolist()]


def braking(snapshot: WorldSnapshot, before: WorldSnapshot | None) -> list[bool]:
    """(n,) of others in their order. before: the tick before; without it no vehicle is seen to brake."""
    actors = snapshot.actors
    then: dict[int, float] = (
        {} if before is None else dict(zip(before.actors.index.tolist(), before.actors.speed.tolist(), strict=True))
    )
    return [
        then.get(row, speed) - speed > _BRAKES_MPS2 * DT_S
        for row, speed in zip(actors.index.tolist(), actors.speed.tolist(), strict=True)
    ]


def ego_brakes(snapshot: WorldSnapshot, before: WorldSnapshot | None) -> bool:
    return before is not None and before.ego.speed - snapshot.ego.speed > _BRAKES_MPS2 * DT_S


def named_from(events: Iterable[Violation], names: Sequence[str]) -> dict[str, float]:
    """Time (s) of the first violation whose sentence names each road user."""
    found: dict[str, float] = {}
    for event in sorted(events, key=lambda e: e.start_s):
        for name in names:
            if name not in found and re.search(rf"\b{re.escape(name)}\b", event.sentence):
                found[name] = event.start_s
    return found


_AROUND_OBSTACLE_M = 2.0


def rule_zones(scene: Scene) -> list[shapely.Geometry]:
    """The zones of the targets' rules; one without an extent has none."""
    zones = (_rule_zone(scene, sign) for sign in scene.target_signs)
    return [zone for zone in zones if zone is not None]


def _rule_zone(scene: Scene, sign: SignInstance) -> shapely.Geometry | None:
    network = scene.network
    match sign.params:
        case ReservedLaneParams(zone_edges=edges, lanes=names):
            only = frozenset(names)
            against = [network.lane(name) for name in sorted(only) if network.lane(name).edge not in edges]
            return _against(network, sign, edges, against) if against else _stretch(scene, sign, edges, only)
        case ZoneParams(zone_edges=edges):
            return _stretch(scene, sign, edges, frozenset())
        case RoundaboutParams(ring=ring):
            lanes = [lane for edge in ring for lane in network.edge_lanes(edge)]
            lanes += [lane for a in ring for b in ring for lane in _between(network, a, b, frozenset())]
            return _union([strip(lane.line, lane.width) for lane in lanes])
        case CrosswalkParams(crossing=name):
            crossing = network.crossings[name]
            return strip(crossing.line, crossing.width)
        case ObstacleParams(obstacle=name):
            o = next(o for o in scene.obstacles if o.id == name)
            return shapely.Polygon(corners(o.x, o.y, o.heading, o.length, o.width)).buffer(_AROUND_OBSTACLE_M)
        case JunctionParams(junction=name):
            area = network.junctions[name].polygon
            return shapely.Polygon(area).buffer(0) if len(area) >= 3 else None
        case ApproachParams() | None:
            return _stretch(scene, sign, (sign.edge,), frozenset())
        case params:
            raise TypeError(f"no drawing of the zone of {type(params).__name__}")


def _stretch(scene: Scene, sign: SignInstance, edges: tuple[str, ...], only: frozenset[str]) -> shapely.Geometry | None:
    """The lanes of edges from the plate's line to its end plate's, and what joins them."""
    network = scene.network
    end = next((s for s in scene.signs if s.ends == sign.id), None)
    areas, before = [], ""
    for edge in edges:
        if before:
            areas += [strip(lane.line, lane.width) for lane in _between(network, before, edge, only)]
        for lane in network.edge_lanes(edge):
            if only and lane.id not in only:
                continue
            a = min(sign.position_m, lane.line.length) if edge == sign.edge else 0.0
            b = lane.line.length if end is None or edge != end.edge else min(end.position_m, lane.line.length)
            if b - a > 0.1:
                areas.append(strip(lane.line.slice(a, b), lane.width))
        if end is not None and edge == end.edge:
            break
        before = edge
    return _union(areas)


def _against(
    network: RoadNetwork, sign: SignInstance, edges: tuple[str, ...], lanes: list[Lane]
) -> shapely.Geometry | None:
    """Lanes of the opposite direction, as far as they run beside the edges behind the plate's line."""
    first, last = network.edge_lanes(edges[0])[-1].line, network.edge_lanes(edges[-1])[-1].line
    ends = (first.point_at(min(sign.position_m, first.length)), last.point_at(last.length))
    areas = []
    for lane in lanes:
        a, b = sorted(lane.line.project(*end)[0] for end in ends)
        if b - a > 0.1:
            areas.append(strip(lane.line.slice(a, b), lane.width))
    return _union(areas)


def _between(network: RoadNetwork, source: str, target: str, only: frozenset[str]) -> list[Lane]:
    lanes = network.lanes
    return [
        lanes[via]
        for i in network.edges[source].lanes
        for c in network.outgoing[i]
        if lanes[c.to_lane].edge == target and (not only or lanes[c.to_lane].id in only)
        for via in c.via
    ]


def _union(areas: list[shapely.Geometry]) -> shapely.Geometry | None:
    return shapely.union_all(areas) if areas else None


def destination_place(scene: Scene) -> tuple[shapely.Geometry, tuple[float, float]]:
    """The stretch of road in which the ego has arrived, and its middle."""
    s = scene.destination.s
    lanes = scene.network.edge_lanes(scene.destination.edge)
    areas, middles = [], []
    for lane in [lane for lane in lanes if lane.permits("passenger")] or lanes:
        middles.append(lane.line.point_at(s))
        a, b = max(s - ARRIVAL_M, 0.0), min(s + ARRIVAL_M, lane.line.length)
        if b - a >= 0.1:
            areas.append(strip(lane.line.slice(a, b), lane.width))
    x, y = np.mean(middles, axis=0).tolist()
    return shapely.union_all(areas), (x, y)


def plate_line(scene: Scene, sign: SignInstance) -> Array:
    """The cross-section of the road at which a target's rule judges the ego's front, (2, 2).

    Of a junction's sign the end of its edge, each lane's own; of a pedestrian crossing the near side of its strip.
    """
    network = scene.network
    lanes = network.edge_lanes(sign.edge)
    outer, inner, kerb = lanes[0], lanes[-1], network.to_kerb
    at = min(sign.position_m, outer.line.length), min(sign.position_m, inner.line.length)
    if scene.catalog.sign(sign.code).placement.reference == "line":
        at = outer.line.length, inner.line.length
    elif isinstance(sign.params, CrosswalkParams):
        crossing = network.crossings[sign.params.crossing]
        middle = crossing.line.point_at(crossing.line.length / 2)
        begin = outer.line.project(*middle)[0] - crossing.width / 2
        at = begin, begin
    ends = (outer.line.point_at(at[0], kerb * outer.width / 2), inner.line.point_at(at[1], -kerb * inner.width / 2))
    return np.array(ends)


def way_off(network: RoadNetwork, sign: SignInstance) -> tuple[Array, float]:
    """Unit vector in the picture that leads from a post off the road, and how far the kerb is, m (0 beside it)."""
    # Towards the kerb of the traffic that the plate faces; pixel rows grow downwards.
    kerb = network.to_kerb
    outwards = -kerb * np.array([math.sin(sign.heading), math.cos(sign.heading)])
    lanes = network.edge_lanes(sign.edge)
    to_kerb = lanes[0].width / 2 - kerb * lanes[0].line.project(sign.x, sign.y)[1]
    to_middle = lanes[-1].width / 2 + kerb * lanes[-1].line.project(sign.x, sign.y)[1]
    if min(to_kerb, to_middle) <= 0.0:
        return (outwards if to_kerb <= 0.0 else -outwards), 0.0
    edge = network.edges[sign.edge]
    two_way = any((e.source, e.target) == (edge.target, edge.source) for e in network.edges.values())
    # A post on an island: to the nearer kerb, but never over the other direction's lanes.
    return (outwards, to_kerb) if two_way or to_kerb <= to_middle else (-outwards, to_middle)


def way_points(scene: Scene, graph: LaneGraph, edges: tuple[str, ...], d: float) -> Array:
    """A way over edges from the start to the destination, d to the left, (n, 2); empty if no way leads there."""
    start = scene.network.lane(scene.start.lane)
    path = graph.path(edges, start.index, scene.start.s, scene.destination) if edges else None
    if path is None:
        return np.zeros((0, 2))
    line = path.line.slice(0.0, path.destination_s) if path.destination_s > 1.0 else path.line
    return rounded(line).beside(d)


# As tsbench.make.scenes.traffic names the cars that are only traffic.
_BACKGROUND = "bg_"
_CAR_M = (5.0, 1.8)


def ego_body(x: float, y: float, heading: float) -> Body:
    return Body("ego", EGO_ID, x, y, heading, EGO_LENGTH_M, EGO_WIDTH_M)


def staged_bodies(scene: Scene) -> list[Body]:
    """All cars that the scene itself is made of, and its held pedestrians.

    Not the ego, the background's cars, nor what stands for an obstacle. Kind `convoy`: held until the ego comes; at its
    entry if it enters only then.
    """
    root = read_additional(scene.additional.path, scene.additional.content)
    return [*_cars(scene, root), *_walkers(scene, root)]


def _cars(scene: Scene, root: etree._Element) -> Iterator[Body]:
    held = scene.convoy.vehicles if scene.convoy is not None else ()
    others = {EGO_ID, *(o.id for o in scene.obstacles)}
    types = {t.get("id"): t for t in root.iterfind("vType")}
    for vehicle in root.iterfind("vehicle"):
        name, route = str(vehicle.get("id")), vehicle.find("route")
        if name in others or name.startswith(_BACKGROUND) or route is None:
            continue
        vtype = types.get(vehicle.get("type"))
        length, width = (
            default if vtype is None else float(vtype.get(key, default))
            for key, default in zip(("length", "width"), _CAR_M, strict=True)
        )
        lanes = scene.network.edge_lanes(str(route.get("edges", "")).split()[0])
        lane = lanes[min(int(vehicle.get("departLane", 0)), len(lanes) - 1)]
        # SUMO counts along the lane's own length, which may differ from that of its drawn line.
        place = vehicle.get("departPos", "base")
        front = length if place == "base" else float(place)
        s = (front - length / 2) * lane.line.length / lane.length
        x, y = lane.line.point_at(s)
        kind = "car" if vtype is None or vtype.get("vClass") != _BICYCLE else _BICYCLE
        shown = "convoy" if name in held and kind != _BICYCLE else kind
        yield Body(shown, name, x, y, lane.line.heading_at(s), length, width)


def _walkers(scene: Scene, root: etree._Element) -> Iterator[Body]:
    if scene.walkers is None:
        return
    for person in root.iterfind("person"):
        name, walk = str(person.get("id")), person.find("walk")
        if name in scene.walkers.persons and walk is not None:
            lane = scene.network.edge_lanes(str(walk.get("edges", "")).split()[0])[0]
            s, d = float(person.get("departPos", 0)), float(walk.get("departPosLat", 0))
            x, y = lane.line.point_at(s, d)
            yield Body("pedestrian", name, x, y, 0.0, 0.0, 0.0)


_CONVOY_PREFIX, _BICYCLE = "convoy", "bicycle"
_WAY_M = 0.35
# Beside the middle of the lane, where there are two ways to show.
_WAY_APART_M = 0.4
_RING_M = ((1.5, "marking"), (1.1, "destination"), (0.5, "marking"))


def way_shapes(scene: Scene, graph: LaneGraph) -> Iterator[Line]:
    """The obedient way, where it is another one than navigation's, and navigation's."""
    ways = [("route", scene.route_hint, _WAY_APART_M if scene.compliant_hint else 0.0)]
    if scene.compliant_hint and scene.compliant_hint != scene.route_hint:
        ways.insert(0, ("compliant", scene.compliant_hint, -_WAY_APART_M))
    for colour, edges, d in ways:
        points = way_points(scene, graph, edges, d)
        if len(points):
            yield Line(colour, points, _WAY_M)


def furniture_shapes(scene: Scene, country: Country | None = None) -> Iterator[Shape]:
    """What plates have painted, destination, the line at which the target begins to bind, obstacles and plates.

    country: whose plates a user asks for.
    """
    yield from mark_shapes(scene.network, scene)
    ground, middle = destination_place(scene)
    yield Area("destination", ground, 0.6)
    for radius, colour in _RING_M:
        yield Area(colour, shapely.Point(middle).buffer(radius))
    for target in scene.target_signs:
        for dash in dashes(plate_line(scene, target), 0.7, 0.5):
            yield Line("plate_line", dash, 0.25)
    yield from obstacle_bodies(scene)
    turning, artwork = main_roads(scene.network, scene.signs), scene.artwork(country)
    for sign in sorted(scene.signs, key=lambda s: s.id not in scene.targets):
        away, clear = way_off(scene.network, sign)
        yield DrawnPlate(
            name=sign.id, role=sign.role, code=sign.code, value=sign.value, x=sign.x, y=sign.y, heading=sign.heading,
            away=away, clear=clear, target=sign.id in scene.targets, artwork=artwork,
            below=turning[sign.id].key if sign.id in turning else "", temporary=sign.temporary,
        )  # fmt: skip


def obstacle_bodies(scene: Scene) -> list[Body]:
    return [
        Body("cones" if o.shape == "cones" else "island", o.id, o.x, o.y, o.heading, o.length, o.width)
        for o in scene.obstacles
    ]


def start_shapes(scene: Scene) -> Iterator[Body]:
    yield from staged_bodies(scene)
    line = scene.network.lane(scene.start.lane).line
    yield ego_body(*line.point_at(scene.start.s), line.heading_at(scene.start.s))


def scene_shapes(scene: Scene, graph: LaneGraph, start: bool = False) -> Iterator[Shape]:
    """All that a scene puts on its roads. start: for a scene without an episode, also who stands there at first."""
    yield from (Area("plate_line", zone, 0.22) for zone in rule_zones(scene))
    yield from way_shapes(scene, graph)
    yield from furniture_shapes(scene)
    if start:
        yield from start_shapes(scene)


def tick_shapes(
    snapshot: WorldSnapshot, before: WorldSnapshot | None = None, traffic_view: TrafficView | None = None
) -> list[Body]:
    """Road users at a tick. before: the tick before, which shows who brakes; traffic_view: shows indicators."""
    actors, table = snapshot.actors, snapshot.actors.table
    rows = actors.index
    sizes = np.column_stack((table.length[rows], table.width[rows])).tolist()
    sides = [0] * len(actors) if traffic_view is None else indicators(traffic_view, snapshot)
    bodies = [
        Body(body_kind(table, row), table.ids[row], x, y, heading, length, width, signals=side, brakes=brakes)
        for row, (x, y, heading), (length, width), side, brakes in zip(
            rows.tolist(), actors.pose.tolist(), sizes, sides, braking(snapshot, before), strict=True
        )
    ]
    ego = snapshot.ego
    return [*bodies, replace(ego_body(ego.x, ego.y, ego.heading), brakes=ego_brakes(snapshot, before))]


def body_kind(table: ActorTable, row: int) -> str:
    kind = ActorKind(int(table.kind[row])).name.lower()
    # A bicycle of a convoy stays a bicycle: road users that wait for the ego are coloured, and bicycles are no boxes.
    return "convoy" if table.ids[row].startswith(_CONVOY_PREFIX) and kind != _BICYCLE else kind
