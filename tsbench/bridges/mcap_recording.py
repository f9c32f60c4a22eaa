"""An episode as an MCAP recording with Foxglove's schemas, for Foxglove, Lichtblick and whatever reads MCAP.

Channels: /scene (all that a picture of the scene shows; once), /actors (all, each tick), /tf (map to ego), /ego
(JSON: what the ego does), /violations (log lines). Time begins at 0. Units: m, s, rad, in the network's frame.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from foxglove import Channel, Context, open_mcap
from foxglove.channels import FrameTransformChannel, LogChannel, SceneUpdateChannel
from foxglove.mcap import MCAPWriteOptions
from foxglove.messages import (
    Color,
    CubePrimitive,
    FrameTransform,
    KeyValuePair,
    LinePrimitive,
    LinePrimitiveLineType,
    Log,
    LogLevel,
    Point3,
    Pose,
    Quaternion,
    SceneEntity,
    SceneEntityDeletion,
    SceneEntityDeletionType,
    SceneUpdate,
    TextPrimitive,
    Timestamp,
    TriangleListPrimitive,
    Vector3,
)

import tsbench
from tsbench.core.files import io_errors_as_input_errors, replacing
from tsbench.episode.trace import Trace
from tsbench.geometry.polyline import Array
from tsbench.report.drawing.canvas import ATTRIBUTION, STYLE, Area, Body, DrawnPlate, Line, Shape
from tsbench.report.drawing.road_shapes import road_shapes
from tsbench.report.drawing.scene_shapes import scene_shapes, tick_shapes
from tsbench.report.wording import scene_facts, sign_words
from tsbench.roads.lane_graph import LaneGraph
from tsbench.rules.monitor import Violation
from tsbench.sim.scene import Scene
from tsbench.sim.scene_file import EGO_ID
from tsbench.sim.world import DT_S, WorldSnapshot

FRAME = "map"
# Entities of the ground are named as the colours are, but for these.
_NAMES = {"asphalt": "road", "reserved": "other lanes"}
# What is painted later lies higher, or a viewer could not tell what covers what.
_STEP_Z, _PLATE_Z = 0.005, 2.0
_PLATE_M = (0.1, 0.7, 0.7)
_LETTER_M = 1.2
_SIMPLER_M = 0.05
_CAR_HEIGHT_M = 1.5
_HEIGHTS_M = {"bus": 3.0, "pedestrian": 1.75, "bicycle": 1.7, "cones": 0.8, "island": 0.8}


def entities(shapes: Iterable[Shape], now: Timestamp | None = None) -> list[SceneEntity]:
    """One entity for each colour of the ground, each body and each plate."""
    shapes = list(shapes)
    surfaces: dict[str, list[TriangleListPrimitive]] = defaultdict(list)
    lines: dict[str, list[LinePrimitive]] = defaultdict(list)
    painted = [shape for shape in shapes if isinstance(shape, Area | Line)]
    for level, (_, run) in enumerate(groupby(painted, _look)):
        first, *rest = run
        name, z = _NAMES.get(first.colour, first.colour), _STEP_Z * level
        if isinstance(first, Area):
            polygons = [area.polygon for area in (first, *rest) if isinstance(area, Area)]
            surfaces[name].append(_surface(first, polygons, z))
        else:
            lines[name].append(_lines(first, [line.points for line in (first, *rest) if isinstance(line, Line)], z))
    ground = [
        SceneEntity(frame_id=FRAME, id=name, timestamp=now, triangles=surfaces[name], lines=lines[name])
        for name in dict.fromkeys((*surfaces, *lines))
    ]
    standing = [_body(body, now) for body in shapes if isinstance(body, Body)]
    return [*ground, *standing, *(_plate(plate, now) for plate in shapes if isinstance(plate, DrawnPlate))]


def turned(heading: float) -> Quaternion:
    return Quaternion(x=0.0, y=0.0, z=math.sin(heading / 2), w=math.cos(heading / 2))


def _look(shape: Area | Line) -> tuple[str, bool, float]:
    """Neighbours that look alike are one primitive."""
    is_area = isinstance(shape, Area)
    return shape.colour, is_area, shape.opacity if isinstance(shape, Area) else shape.width


def _colour(name: str, opacity: float = 1.0) -> Color:
    red, green, blue = (channel / 255 for channel in getattr(STYLE, name))
    return Color(r=red, g=green, b=blue, a=opacity)


def _pose(x: float, y: float, heading: float, z: float) -> Pose:
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=turned(heading))


def _points(points: Array, z: float) -> list[Point3]:
    return [Point3(x=x, y=y, z=z) for x, y in points.tolist()]


def _surface(look: Area, polygons: Sequence[shapely.Geometry], z: float) -> TriangleListPrimitive:
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(shapely.simplify(polygons, _SIMPLER_M)))
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3].reshape(-1, 2)
    return TriangleListPrimitive(
        pose=_pose(0.0, 0.0, 0.0, 0.0), points=_points(corners, z), color=_colour(look.colour, look.opacity)
    )


def _lines(look: Line, lines: Sequence[Array], z: float) -> LinePrimitive:
    pieces = np.concatenate([np.stack((line[:-1], line[1:]), axis=1).reshape(-1, 2) for line in lines])
    kind, pose = LinePrimitiveLineType.LineList, _pose(0.0, 0.0, 0.0, 0.0)
    colour, points = _colour(look.colour), _points(pieces, z)
    return LinePrimitive(type=kind, pose=pose, thickness=look.width, color=colour, points=points)


def _cube(x: float, y: float, heading: float, z: float, size: tuple[float, float, float], colour: str) -> CubePrimitive:
    """size: length, width, height; z: of its middle."""
    length, width, height = size
    return CubePrimitive(pose=_pose(x, y, heading, z), size=Vector3(x=length, y=width, z=height), color=_colour(colour))


def _body(body: Body, now: Timestamp | None) -> SceneEntity:
    size = (body.length, body.width, _HEIGHTS_M.get(body.kind, _CAR_HEIGHT_M))
    colour = "cone" if body.kind == "cones" else body.kind
    cube = _cube(body.x, body.y, body.heading, size[2] / 2, size, colour)
    return SceneEntity(frame_id=FRAME, id=body.name, timestamp=now, cubes=[cube])


def _plate(plate: DrawnPlate, now: Timestamp | None) -> SceneEntity:
    """A plate on its post, facing its traffic, below a text that turns to the camera."""
    colour = "plate_line" if plate.target else "marking"
    pose, words = _pose(plate.x, plate.y, 0.0, _PLATE_Z + 1.0), sign_words(plate.artwork, plate.code, plate.value)
    text = TextPrimitive(pose=pose, billboard=True, font_size=_LETTER_M, color=_colour(colour), text=words)
    known = [KeyValuePair(key="role", value=plate.role), KeyValuePair(key="code", value=plate.code)]
    cube = _cube(plate.x, plate.y, plate.heading, _PLATE_Z, _PLATE_M, colour)
    return SceneEntity(frame_id=FRAME, id=plate.name, timestamp=now, cubes=[cube], texts=[text], metadata=known)


_TICK_NS = round(DT_S * 1e9)
_EGO_FIELDS = {
    "speed": "m/s",
    "acceleration": "m/s2",
    "steering": "rad",
    "yaw_rate": "rad/s",
    "x": "m",
    "y": "m",
    "heading": "rad",
    "s": "m along the lane",
    "d": "m left of the lane's middle",
}
_EGO_SCHEMA: dict[str, Any] = {
    "type": "object",
    "title": "tsbench.Ego",
    "properties": {
        **{name: {"type": "number", "description": unit} for name, unit in _EGO_FIELDS.items()},
        "lane": {"type": "string", "description": "SUMO lane id, empty off the lanes"},
    },
}


def write_recording(trace: Trace, scene: Scene, path: Path) -> None:
    context = Context()
    with (
        io_errors_as_input_errors(path),
        replacing(path) as part,
        open_mcap(
            part, allow_overwrite=True, context=context, writer_options=MCAPWriteOptions(compression_threads=0)
        ) as writer,
    ):
        writer.write_metadata("tsbench", _facts(trace, scene))
        shapes = (*road_shapes(scene.network, scene), *scene_shapes(scene, LaneGraph(scene.network)))
        SceneUpdateChannel("/scene", context=context).log(SceneUpdate(entities=entities(shapes)), log_time=0)
        actors = SceneUpdateChannel("/actors", context=context)
        frames = FrameTransformChannel("/tf", context=context)
        egos = Channel("/ego", schema=_EGO_SCHEMA, context=context)
        events = list(trace.against)
        log = LogChannel("/violations", context=context)
        gone: set[str] = set()
        for tick, snapshot in enumerate(trace.snapshots):
            now = tick * _TICK_NS
            update, gone = _actors(snapshot, gone)
            actors.log(update, log_time=now)
            frames.log(_frame(snapshot), log_time=now)
            ego = snapshot.ego
            own = {name: getattr(ego, name) for name in _EGO_FIELDS}
            egos.log({**own, "lane": scene.network.lanes[ego.lane].id if ego.lane >= 0 else ""}, log_time=now)
            while events and round(events[0].start_s / DT_S) <= tick:
                log.log(_message(events.pop(0)), log_time=now)


def _facts(trace: Trace, scene: Scene) -> dict[str, str]:
    return {
        "tsbench": tsbench.__version__,
        "planner": trace.planner,
        "scenario_id": trace.spec.scenario_id,
        "outcome": str(trace.outcome),
        "compliant": str(trace.verdicts.compliant).lower(),
        "roads": f"{ATTRIBUTION}, ODbL 1.0",
        **scene_facts(scene),
    }


def _time(seconds: float) -> Timestamp:
    whole, part = divmod(round(seconds * 1e9), 1_000_000_000)
    return Timestamp(whole, part)


def _actors(snapshot: WorldSnapshot, before: set[str]) -> tuple[SceneUpdate, set[str]]:
    """The road users of a tick, the removal of those that have left, and those that are there."""
    now, bodies = _time(snapshot.time), tick_shapes(snapshot)
    present = {body.name for body in bodies}
    deletions = [
        SceneEntityDeletion(timestamp=now, type=SceneEntityDeletionType.MatchingId, id=name)
        for name in sorted(before - present)
    ]
    return SceneUpdate(deletions=deletions, entities=entities(bodies, now)), present


def _frame(snapshot: WorldSnapshot) -> FrameTransform:
    ego = snapshot.ego
    when, place, turn = _time(snapshot.time), Vector3(x=ego.x, y=ego.y, z=0.0), turned(ego.heading)
    return FrameTransform(
        timestamp=when, parent_frame_id=FRAME, child_frame_id=EGO_ID, translation=place, rotation=turn
    )


def _message(event: Violation) -> Log:
    return Log(timestamp=_time(event.start_s), level=LogLevel.Error, name=event.clause, message=event.sentence)
