"""One traced episode for the player: what moves as quantised second differences, what does not as JSON.

A few kilobytes after compression. Places are within half a unit (2.5 cm where the episode is not kilometres long),
headings within 0.1 degrees, speeds within 2.5 cm/s: fine for looking, never for judging, so the violations' own figures
stand in the header as the monitors gave them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from tsbench.core.errors import InputError
from tsbench.episode.trace import Trace, read_trace, to_dict
from tsbench.episode.traffic_view import TrafficView
from tsbench.geometry.polyline import Array
from tsbench.metrics.tracks import actor_tracks, ego_rows
from tsbench.report.drawing.road_shapes import ground_shapes, road_shapes
from tsbench.report.drawing.scene_shapes import body_kind, braking, ego_brakes, indicators, named_from, scene_shapes
from tsbench.report.page.page_format import deltas, drawing, pack, plate_key, plate_keys, plate_of
from tsbench.report.time_to_collision import FARTHEST_S, times_to_collision, times_to_conflict
from tsbench.report.wording import episode_subtitle, episode_title, readable, under_other_sign, unit_words
from tsbench.roads.planner_map import build_planner_map
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec, other_halves
from tsbench.signs.annotations import DISTRACTOR
from tsbench.signs.countries import Artwork
from tsbench.signs.rule_kinds import GiveWayParams
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S, EGO_LENGTH_M, EGO_WIDTH_M

_UNIT_M, _UNIT_RAD, _UNIT_MPS = 0.05, 2 * np.pi / 2048, 0.05
_UNIT_MPS2, _UNIT_S = 0.05, 0.1
# In one number; by the sides of `indicators`.
_SIDES, _BRAKES = MappingProxyType({0: 0, 1: 1, -1: 2}), 4
_ROOM_M = 12.0
_LARGEST = 30_000
# A planner may mean anything: second differences of its points fit into 16 bits wherever they are.
_PLAN_UNITS, _PLAN_FARTHEST = 4, 8_000


@dataclass(frozen=True)
class Packed:
    """A player's data. net: hash of its network, `roads`; plates: keys of the plates that stand there."""

    episode: bytes
    net: str
    roads: bytes
    plates: tuple[str, ...]


class EpisodePacker:
    """Packs traces; networks that several of them share are read once."""

    def __init__(self, data: DataSet, loader: SceneLoader | None = None) -> None:
        self._data, self._loader = data, SceneLoader(data) if loader is None else loader
        self._roads: dict[str, bytes] = {}
        self._others: dict[str, dict[str, ScenarioSpec]] = {}

    def pack(self, path: Path, key: tuple[str, str]) -> Packed:
        """The trace at `path`, which is to be that of `key` (planner, scenario).

        Raises InputError: no whole trace, that of another episode, or one whose scene is no longer there.
        """
        trace = read_trace(path)
        if (trace.planner, trace.spec.scenario_id) != key:
            raise InputError(f"{path}: is the trace of {trace.planner} {trace.spec.scenario_id}")
        scene, roads = self._loader.load(trace.spec)
        track = ego_rows(trace)
        if not np.isfinite(track).all():
            raise InputError(f"{path}: the ego's state is not finite: nothing to draw")
        points = np.array([*track[:, :2], *((s.x, s.y) for s in scene.signs if s.role not in ("context", DISTRACTOR))])
        furnished = drawing(scene_shapes(scene, roads.graph))
        header = {
            **_about(trace, scene.artwork()),
            "otherwise": self._otherwise(trace, scene),
            "told": _told(trace, scene),
            "named": named_from(
                trace.against, (*trace.snapshots[-1].actors.table.ids, *(o.id for o in scene.obstacles))
            ),
            "obstacles": [[o.id, round(o.x, 2), round(o.y, 2)] for o in scene.obstacles],
            "gap_s": _gap(scene),
            "roads": trace.spec.net_sha256,
            "scene": furnished,
            "box": np.round((points.min(axis=0) - _ROOM_M, points.max(axis=0) + _ROOM_M), 1).ravel().tolist(),
        }
        parts, arrays = _motion(trace, track)
        arrays["actor_lights"], arrays["ego_lights"] = _lights(trace, scene)
        conflict = times_to_conflict(trace, scene)
        if conflict is not None:
            arrays["ego_conflict"] = deltas(np.rint(conflict / _UNIT_S), np.zeros(1, dtype=np.int64))
        net = trace.spec.net_sha256
        if net not in self._roads:
            shapes = (*ground_shapes(scene, trace.spec.map_id), *road_shapes(scene.network, scene))
            self._roads[net] = pack({"drawing": drawing(shapes)})
        return Packed(pack({**header, **parts}, arrays), net, self._roads[net], plate_keys(furnished))

    def _otherwise(self, trace: Trace, scene: Scene) -> str:
        """What a failed drive of one half would have in the other; "" for any other, and for one of other scenes."""
        spec = trace.spec
        if not (spec.pair_id and trace.against):
            return ""
        if spec.split not in self._others:
            self._others[spec.split] = other_halves(self._data.table(spec.split))
        others = self._others[spec.split]
        other = others.get(spec.scenario_id)
        if other is None or others[other.scenario_id] != spec:
            return ""
        return under_other_sign(scene, self._loader.load(other)[0], trace.snapshots)


def pack_plate(artwork: Artwork, key: str) -> bytes:
    """A plate's picture. Raises InputError or ValueError for a key that names none."""
    return pack({"svg": plate_of(artwork, key)})


def _about(trace: Trace, artwork: Artwork) -> dict[str, Any]:
    spec = trace.spec
    others = [event for verdict in trace.verdicts.others for event in verdict.violations]
    events = [
        {"target": target, **event, "unit": unit_words(event["unit"]), "sentence": readable(event["sentence"])}
        for found, target in ((trace.against, True), (others, False))
        for event in map(to_dict, found)
    ]
    told = {
        "planner": trace.planner,
        "scenario": spec.scenario_id,
        "which": spec.which,
        "title": episode_title(trace),
        "subtitle": episode_subtitle(trace, artwork),
        "plate": plate_key(spec.sign_code, spec.sign_value),
        "outcome": str(trace.outcome),
    }
    judged = {"engaged": trace.verdicts.engaged, "compliant": trace.verdicts.compliant}
    partner = None if trace.contact is None else trace.contact.partner
    events.sort(key=lambda e: (e["start_s"], not e["target"]))
    return {**told, "error": trace.error, **judged, "partner": partner, "events": events}


def _gap(scene: Scene) -> float | None:
    """What a target's rule asks to be left to vehicles with priority, s; None where there are none."""
    for sign in scene.target_signs:
        if isinstance(sign.params, GiveWayParams) and sign.params.main_in:
            return scene.rule(sign).thresholds["gap_s"]
    return None


def _told(trace: Trace, scene: Scene) -> list[dict[str, Any]]:
    """What imperfect eyes told, beside what stood there; "" for a post, and where nothing stood."""
    stood = {sign.id: plate_key(sign.code, sign.value, temporary=sign.temporary) for sign in scene.signs}
    return [
        {
            "time": trace.snapshots[one.step].time,
            "kind": one.kind,
            "told": plate_key(one.code, one.value) if one.code else "",
            "stood": stood.get(one.sign, ""),
            "target": one.role == "target",
        }
        for one in trace.told
    ]


def _motion(trace: Trace, track: Array) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
    """Ego and road users. Pieces: [actor, first tick, ticks] without a gap, in the order of the arrays."""
    snapshots, tracks = trace.snapshots, actor_tracks(trace)
    pose = np.concatenate([np.zeros((0, 4)), *(t.rows for t in tracks)])
    lengths = [len(t.rows) for t in tracks]
    starts = np.cumsum([0, *lengths])[:-1]
    middle = (track[:, :2].min(axis=0) + track[:, :2].max(axis=0)) / 2
    reach = max(float(np.abs(p - middle).max()) for p in (track[:, :2], pose[:, :2]) if len(p))
    unit = max(_UNIT_M, reach / _LARGEST)
    arrays: dict[str, npt.NDArray[Any]] = {}
    for name, xyh, at in (("ego", track, np.zeros(1, dtype=np.int64)), ("actor", pose, starts)):
        for k, axis in enumerate("xy"):
            arrays[f"{name}_{axis}"] = deltas(np.rint((xyh[:, k] - middle[k]) / unit), at)
        arrays[f"{name}_h"] = deltas(_turns(xyh[:, 2], at), at)
    for name, values in {
        "v": track[:, 3] / _UNIT_MPS,
        "a": np.array([s.ego.acceleration for s in snapshots]) / _UNIT_MPS2,
        "steer": np.array([s.ego.steering for s in snapshots]) / _UNIT_RAD,
        "ttc": times_to_collision(snapshots) / _UNIT_S,
    }.items():
        arrays[f"ego_{name}"] = deltas(np.rint(values), np.zeros(1, dtype=np.int64))
    told = [(tick, plan) for tick, plan in enumerate(trace.plans) if plan is not None and len(plan)]
    plans = np.concatenate([np.zeros((0, 2)), *(plan for _, plan in told)])
    at = np.cumsum([0, *(len(plan) for _, plan in told)])[:-1]
    for k, axis in enumerate("xy"):
        near = (plans[:, k] - middle[k]) / (_PLAN_UNITS * unit)
        arrays[f"plan_{axis}"] = deltas(np.rint(np.clip(near, -_PLAN_FARTHEST, _PLAN_FARTHEST)), at)
    table = snapshots[-1].actors.table
    sizes = np.round(np.column_stack((table.length, table.width))[: len(table.ids)], 2).tolist()
    actors = [
        [name, body_kind(table, row), *size] for row, (name, size) in enumerate(zip(table.ids, sizes, strict=True))
    ]
    pieces = [[t.index, t.first, n] for t, n in zip(tracks, lengths, strict=True)]
    units = {
        "m": unit,
        "plan": _PLAN_UNITS * unit,
        "rad": _UNIT_RAD,
        "mps": _UNIT_MPS,
        "mps2": _UNIT_MPS2,
        "s": _UNIT_S,
    }
    parts: dict[str, Any] = {
        "dt": DT_S,
        "ticks": len(snapshots),
        "start": snapshots[0].time,
        "ego": [EGO_LENGTH_M, EGO_WIDTH_M],
        "actors": actors,
        "pieces": pieces,
        "plans": [[tick, len(plan)] for tick, plan in told],
        "middle": middle.tolist(),
        "farthest_s": FARTHEST_S,
        "units": units,
    }
    return parts, arrays


def _lights(trace: Trace, scene: Scene) -> tuple[npt.NDArray[np.int8], npt.NDArray[np.int8]]:
    """Of road users in the order of the arrays of their motion, and of the ego: 1 left, 2 right indicator, 4 brakes."""
    traffic_view, before, tables = TrafficView(scene.network, build_planner_map(scene.network)), None, []
    ego = np.zeros(len(trace.snapshots), dtype=np.int8)
    for tick, snapshot in enumerate(trace.snapshots):
        ego[tick] = _BRAKES * ego_brakes(snapshot, before)
        sides, brakes = indicators(traffic_view, snapshot), braking(snapshot, before)
        lamps = [_SIDES[side] + _BRAKES * on for side, on in zip(sides, brakes, strict=True)]
        tables.append(dict(zip(snapshot.actors.index.tolist(), lamps, strict=True)))
        before = snapshot
    tracks = actor_tracks(trace)
    found = [tables[t.first + k][t.index] for t in tracks for k in range(len(t.rows))]
    return np.array(found, dtype=np.int8), ego


def _turns(heading: Array, starts: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Headings in units, without jumps of a whole turn within a piece."""
    whole = np.rint(heading / _UNIT_RAD).astype(np.int64)
    turn = round(2 * np.pi / _UNIT_RAD)
    steps = np.diff(whole, prepend=0)
    steps = (steps + turn // 2) % turn - turn // 2
    steps[starts] = (whole[starts] + turn // 2) % turn - turn // 2
    total = np.cumsum(steps)
    before = np.zeros(len(whole), dtype=np.int64)
    if len(starts):
        lengths = np.diff(np.append(starts, len(whole)))
        before = np.repeat(total[starts] - steps[starts], lengths)
    return total - before
