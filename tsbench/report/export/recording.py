"""An episode as an MCAP recording with Foxglove's schemas, for Foxglove, Lichtblick and whatever reads MCAP.

Channels: /scene (roads, plates, obstacles, destination; once), /actors (everybody, each tick), /tf (map to ego), /ego
(JSON: what the ego does), /violations (log lines). Time begins at 0. Units: m, s, rad, in the network's frame.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import shapely
from foxglove import Channel, Context, open_mcap
from foxglove.channels import FrameTransformChannel, LogChannel, SceneUpdateChannel
from foxglove.mcap import MCAPWriteOptions
from foxglove.messages import (
    FrameTransform,
    KeyValuePair,
    Log,
    LogLevel,
    SceneEntity,
    SceneEntityDeletion,
    SceneEntityDeletionType,
    SceneUpdate,
    Timestamp,
    Vector3,
)

import tsbench
from tsbench.report.bodies import CONVOY_PREFIX
from tsbench.report.export.shapes import box, lettering, line, plate, surface, turned
from tsbench.report.outfile import whole_file
from tsbench.report.places import destination_place, plate_line
from tsbench.report.style import ATTRIBUTION, STYLE, Colour
from tsbench.rules.base import Violation
from tsbench.run.trace import Trace
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S, EGO_LENGTH_M, EGO_WIDTH_M, ActorKind, EgoState, WorldSnapshot

FRAME, EGO = "map", "ego"
_TICK_NS = round(DT_S * 1e9)
_CAR_HEIGHT_M, _OBSTACLE_HEIGHT_M = 1.5, 0.8
_HEIGHTS_M = {ActorKind.BUS: 3.0, ActorKind.PEDESTRIAN: 1.75, ActorKind.BICYCLE: 1.7}
_COLOURS: dict[ActorKind, Colour] = {
    ActorKind.CAR: STYLE.car, ActorKind.BUS: STYLE.bus, ActorKind.BICYCLE: STYLE.bicycle,
    ActorKind.PEDESTRIAN: STYLE.pedestrian,
}  # fmt: skip
_EGO_FIELDS = {
    "speed": "m/s", "acceleration": "m/s2", "steering": "rad", "yaw_rate": "rad/s", "x": "m", "y": "m",
    "heading": "rad", "s": "m along the lane", "d": "m left of the lane's middle",
}  # fmt: skip
_EGO_SCHEMA: dict[str, Any] = {
    "type": "object",
    "title": "tsbench.Ego",
    "properties": {
        **{name: {"type": "number", "description": unit} for name, unit in _EGO_FIELDS.items()},
        "lane": {"type": "string", "description": "SUMO lane id, empty off the lanes"},
    },
}


def write_recording(trace: Trace, scene: Scene, path: Path) -> None:
    """The whole episode; the same episode gives the same messages."""
    context = Context()
    with (
        whole_file(path) as part,
        open_mcap(
            part,
            allow_overwrite=True,
            context=context,
            writer_options=MCAPWriteOptions(compression_threads=0),
        ) as writer,
    ):
        writer.write_metadata("tsbench", _facts(trace))
        SceneUpdateChannel("/scene", context=context).log(SceneUpdate(entities=_scene(scene)), log_time=0)
        actors = SceneUpdateChannel("/actors", context=context)
        frames = FrameTransformChannel("/tf", context=context)
        egos = Channel("/ego", schema=_EGO_SCHEMA, context=context)
        events = sorted(trace.target.violations, key=lambda event: event.start_s)
        log = LogChannel("/violations", context=context)
        gone: set[str] = set()
        for tick, snapshot in enumerate(trace.snapshots):
            now = tick * _TICK_NS
            update, gone = _actors(snapshot, gone)
            actors.log(update, log_time=now)
            frames.log(_frame(snapshot), log_time=now)
            egos.log(_ego(snapshot.ego, scene), log_time=now)
            while events and round(events[0].start_s / DT_S) <= tick:
                log.log(_message(events.pop(0)), log_time=now)


def _facts(trace: Trace) -> dict[str, str]:
    return {
        "tsbench": tsbench.__version__,
        "planner": trace.planner,
        "scenario_id": trace.spec.scenario_id,
        "outcome": str(trace.outcome),
        "compliant": str(trace.target.compliant).lower(),
        "roads": f"{ATTRIBUTION}, ODbL 1.0",
    }


def _time(seconds: float) -> Timestamp:
    whole, part = divmod(round(seconds * 1e9), 1_000_000_000)
    return Timestamp(whole, part)


def _scene(scene: Scene) -> list[SceneEntity]:
    """What does not move."""
    lanes = [lane for lane in scene.network.lanes if lane.permits("passenger")]
    others = [lane for lane in scene.network.lanes if not lane.permits("passenger")]
    goal = [
        line(shapely.get_coordinates(area.exterior)[:-1], STYLE.destination, 0.4, closed=True)
        for area in shapely.get_parts(destination_place(scene)[0])
    ]
    entities = [
        SceneEntity(frame_id=FRAME, id="road", triangles=[surface(lanes, STYLE.asphalt)]),
        SceneEntity(
            frame_id=FRAME, id="other lanes", triangles=[surface(others, STYLE.reserved)] if others else []
        ),
        SceneEntity(frame_id=FRAME, id="destination", lines=goal),
    ]
    for sign in scene.signs:
        rgb = STYLE.plate_line if sign.id == scene.target else STYLE.marking
        value = "" if sign.value is None else f" ({sign.value:g})"
        entities.append(
            SceneEntity(
                frame_id=FRAME,
                id=sign.id,
                cubes=[plate(sign.x, sign.y, sign.heading, rgb)],
                texts=[lettering(sign.x, sign.y, f"{sign.code}{value}", rgb)],
                lines=[line(plate_line(scene.network, sign), rgb, 0.25)],
                metadata=[
                    KeyValuePair(key="role", value=sign.role),
                    KeyValuePair(key="code", value=sign.code),
                ],
            )
        )
    for o in scene.obstacles:
        cube = box(o.x, o.y, o.heading, (o.length, o.width, _OBSTACLE_HEIGHT_M), STYLE.cone)
        entities.append(SceneEntity(frame_id=FRAME, id=o.id, cubes=[cube]))
    return entities


def _actors(snapshot: WorldSnapshot, before: set[str]) -> tuple[SceneUpdate, set[str]]:
    """The road users of a tick, the removal of those who are no longer there, and who is there."""
    table, actors = snapshot.actors.table, snapshot.actors
    now = _time(snapshot.time)
    ego = snapshot.ego
    size = (EGO_LENGTH_M, EGO_WIDTH_M, _CAR_HEIGHT_M)
    entities = [
        SceneEntity(
            timestamp=now, frame_id=FRAME, id=EGO, cubes=[box(ego.x, ego.y, ego.heading, size, STYLE.ego)]
        )
    ]
    for row, (x, y, heading) in zip(actors.index.tolist(), actors.pose.tolist(), strict=True):
        kind, name = ActorKind(int(table.kind[row])), table.ids[row]
        size = (float(table.length[row]), float(table.width[row]), _HEIGHTS_M.get(kind, _CAR_HEIGHT_M))
        rgb = STYLE.convoy if name.startswith(CONVOY_PREFIX) else _COLOURS[kind]
        cube = box(x, y, heading, size, rgb)
        entities.append(SceneEntity(timestamp=now, frame_id=FRAME, id=name, cubes=[cube]))
    present = {EGO, *(table.ids[row] for row in actors.index.tolist())}
    deletions = [
        SceneEntityDeletion(timestamp=now, type=SceneEntityDeletionType.MatchingId, id=name)
        for name in sorted(before - present)
    ]
    return SceneUpdate(deletions=deletions, entities=entities), present


def _frame(snapshot: WorldSnapshot) -> FrameTransform:
    ego = snapshot.ego
    return FrameTransform(
        timestamp=_time(snapshot.time), parent_frame_id=FRAME, child_frame_id=EGO,
        translation=Vector3(x=ego.x, y=ego.y, z=0.0), rotation=turned(ego.heading),
    )  # fmt: skip


def _ego(ego: EgoState, scene: Scene) -> dict[str, Any]:
    lane = scene.network.lanes[ego.lane].id if ego.lane >= 0 else ""
    return {**{name: getattr(ego, name) for name in _EGO_FIELDS}, "lane": lane}


def _message(event: Violation) -> Log:
    return Log(
        timestamp=_time(event.start_s), level=LogLevel.Error, name=event.clause, message=event.sentence
    )
