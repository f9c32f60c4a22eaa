"""What a scene puts on its roads, and who is there at a tick: as shapes, lowest first. Units: m, rad."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely

from tsbench.report.drawing.initial_state import ego_body, staged_bodies
from tsbench.report.drawing.landmarks import destination_place, plate_line, way_off, way_points
from tsbench.report.drawing.shapes import Area, Body, InferenceClient, Plate, Shape, dashes
from tsbench.report.drawing.zone import rule_zone
from tsbench.roads.lane_graph import LaneGraph
from tsbench.sim.scene import Scene
from tsbench.sim.world import ActorKind, ActorTable, WorldSnapshot

_CONVOY_PREFIX = "convoy"
_WAY_M = 0.35
# Beside the middle of the lane, where there are two ways to show.
_WAY_APART_M = 0.4
_RING_M = ((1.5, "marking"), (1.1, "destination"), (0.5, "marking"))


def zone_shapes(scene: Scene) -> Iterator[Shape]:
    """The ground that the target's rule is about."""
    zone = rule_zone(scene)
    if zone is not None:
        yield Area("plate_line", zone, 0.22)


def way_shapes(scene: Scene, graph: LaneGraph) -> Iterator[InferenceClient]:
    """The obedient way, where it is another one than navigation's, and navigation's."""
    ways = [("route", scene.route_hint, _WAY_APART_M if scene.compliant_hint else 0.0)]
    if scene.compliant_hint and scene.compliant_hint != scene.route_hint:
        ways.insert(0, ("compliant", scene.compliant_hint, -_WAY_APART_M))
    for colour, edges, d in ways:
        points = way_points(scene, graph, edges, d)
        if len(points):
            yield InferenceClient(colour, points, _WAY_M)


def furniture_shapes(scene: Scene) -> Iterator[Shape]:
    """Destination, the line at which the target begins to bind, obstacles and plates, the target's first."""
    ground, middle = destination_place(scene)
    yield Area("destination", ground, 0.6)
    for radius, colour in _RING_M:
        yield Area(colour, shapely.Point(middle).buffer(radius))
    for dash in dashes(plate_line(scene.network, scene.target_sign), 0.7, 0.5):
        yield InferenceClient("plate_line", dash, 0.25)
    for o in scene.obstacles:
        kind = "cones" if o.shape == "cones" else "island"
        yield Body(kind, o.id, o.x, o.y, o.heading, o.length, o.width)
    for sign in sorted(scene.signs, key=lambda s: s.id != scene.target):
        away, clear = way_off(scene.network, sign)
        yield Plate(
            sign.id, sign.role, sign.code, sign.value, sign.x, sign.y, sign.heading, away, clear,
            sign.id == scene.target,
        )  # fmt: skip


def start_shapes(scene: Scene) -> Iterator[Body]:
    """Who stands there before the first tick, the ego on top."""
    yield from staged_bodies(scene)
    line = scene.network.lane(scene.start.lane).line
    yield ego_body(*line.point_at(scene.start.s), line.heading_at(scene.start.s))


def scene_shapes(scene: Scene, graph: LaneGraph, start: bool = False) -> Iterator[Shape]:
    """All that a scene puts on its roads. start: for a scene without an episode, also who stands there at first."""
    yield from zone_shapes(scene)
    yield from way_shapes(scene, graph)
    yield from furniture_shapes(scene)
    if start:
        yield from start_shapes(scene)


def tick_shapes(snapshot: WorldSnapshot) -> list[Body]:
    """Road users of a tick, the ego last."""
    actors, table = snapshot.actors, snapshot.actors.table
    rows = actors.index
    sizes = np.column_stack((table.length[rows], table.width[rows])).tolist()
    bodies = [
        Body(body_kind(table, row), table.ids[row], x, y, heading, length, width)
        for row, (x, y, heading), (length, width) in zip(
            rows.tolist(), actors.pose.tolist(), sizes, strict=True
        )
    ]
    ego = snapshot.ego
    return [*bodies, ego_body(ego.x, ego.y, ego.heading)]


def body_kind(table: ActorTable, row: int) -> str:
    """What a road user is drawn as."""
    if table.ids[row].startswith(_CONVOY_PREFIX):
        return "convoy"
    return ActorKind(int(table.kind[row])).name.lower()
