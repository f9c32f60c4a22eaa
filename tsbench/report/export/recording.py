"""An episode as an MCAP recording with Foxglove's schemas, for Foxglove, Lichtblick and whatever reads MCAP.

Channels: /scene (all that a picture of the scene shows; once), /actors (everybody, each tick), /tf (map to ego), /ego
(JSON: what the ego does), /violations (log lines). Time begins at 0. Units: m, s, rad, in the network's frame.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from foxglove import Channel, Context, open_mcap
from foxglove.channels import FrameTransformChannel, LogChannel, SceneUpdateChannel
from foxglove.mcap import MCAPWriteOptions
from foxglove.messages import (
    FrameTransform,
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
from tsbench.core.files import io_errors_as_input_errors, replacing
from tsbench.episode.trace import Trace
from tsbench.report.description import scene_facts
from tsbench.report.drawing.roads import road_shapes
from tsbench.report.drawing.scene import scene_shapes, tick_shapes
from tsbench.report.drawing.style import ATTRIBUTION
from tsbench.report.export.shapes import FRAME, entities, turned
from tsbench.roads.lane_graph import LaneGraph
from tsbench.rules.monitor import Violation
from tsbench.sim.scene import Scene
from tsbench.sim.scene_file import EGO_ID
from tsbench.sim.world import DT_S, EgoState, WorldSnapshot

_TICK_NS = round(DT_S * 1e9)
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
    context = Context()
    with (
        io_errors_as_input_errors(path),
        replacing(path) as part,
        open_mcap(
            part,
            allow_overwrite=True,
            context=context,
            writer_options=MCAPWriteOptions(compression_threads=0),
        ) as writer,
    ):
        writer.write_metadata("tsbench", _facts(trace, scene))
        SceneUpdateChannel("/scene", context=context).log(SceneUpdate(entities=_scene(scene)), log_time=0)
        actors = SceneUpdateChannel("/actors", context=context)
        frames = FrameTransformChannel("/tf", context=context)
        egos = Channel("/ego", schema=_EGO_SCHEMA, context=context)
        events = trace.events
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


def _facts(trace: Trace, scene: Scene) -> dict[str, str]:
    return {
        "tsbench": tsbench.__version__,
        "planner": trace.planner,
        "scenario_id": trace.spec.scenario_id,
        "outcome": str(trace.outcome),
        "compliant": str(trace.target.compliant).lower(),
        "roads": f"{ATTRIBUTION}, ODbL 1.0",
        **scene_facts(scene),
    }


def _time(seconds: float) -> Timestamp:
    whole, part = divmod(round(seconds * 1e9), 1_000_000_000)
    return Timestamp(whole, part)


def _scene(scene: Scene) -> list[SceneEntity]:
    graph = LaneGraph(scene.network)
    return entities((*road_shapes(scene.network), *scene_shapes(scene, graph)))


def _actors(snapshot: WorldSnapshot, before: set[str]) -> tuple[SceneUpdate, set[str]]:
    """The road users of a tick, the removal of those who are no longer there, and who is there."""
    now, bodies = _time(snapshot.time), tick_shapes(snapshot)
    present = {body.name for body in bodies}
    deletions = [
        SceneEntityDeletion(timestamp=now, type=SceneEntityDeletionType.MatchingId, id=name)
        for name in sorted(before - present)
    ]
    return SceneUpdate(deletions=deletions, entities=entities(bodies, now)), present


def _frame(snapshot: WorldSnapshot) -> FrameTransform:
    ego = snapshot.ego
    return FrameTransform(
        timestamp=_time(snapshot.time), parent_frame_id=FRAME, child_frame_id=EGO_ID,
        translation=Vector3(x=ego.x, y=ego.y, z=0.0), rotation=turned(ego.heading),
    )  # fmt: skip


def _ego(ego: EgoState, scene: Scene) -> dict[str, Any]:
    lane = scene.network.lanes[ego.lane].id if ego.lane >= 0 else ""
    return {**{name: getattr(ego, name) for name in _EGO_FIELDS}, "lane": lane}


def _message(event: Violation) -> Log:
    return Log(
        timestamp=_time(event.start_s), level=LogLevel.Error, name=event.clause, message=event.sentence
    )
