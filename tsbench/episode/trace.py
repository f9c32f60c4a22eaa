"""Traces: every tick of one episode as one Parquet file, `RUN/traces/<planner>/<scenario_id>.parquet`.

A row is a tick; what does not change stands as JSON in the file's metadata. Floats come back bit for bit, so
that a monitor that reads a trace says exactly what it said during the run; the same episode gives the same
bytes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from tsbench.core.errors import InputError
from tsbench.core.files import replacing
from tsbench.core.parquet import OSM_LICENCE, check_size, columns, fields_of
from tsbench.core.plain import dataclass_from_json
from tsbench.core.text import one_line
from tsbench.episode.command import Plan
from tsbench.episode.observation import destination_on_map, ego_on_map
from tsbench.episode.outcome import Contact, EpisodeFacts, Outcome, counted_against
from tsbench.episode.perception import SignDetection
from tsbench.episode.result import EpisodeResult
from tsbench.geometry.polyline import Array
from tsbench.roads.planner_map import PlannerMap
from tsbench.rules.monitor import Verdict, Violation
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.navigation import Navigator, RouteView
from tsbench.sim.scene import Scene
from tsbench.sim.world import ActorKind, Actors, ActorTable, EgoState, WorldSnapshot

TRACE_SCHEMA = 1
_KEY = "tsbench.trace"
_EGO = tuple((column.name, column.type) for column in fields_of(EgoState))
_ACTOR = (
    ("index", pa.int32()), ("x", pa.float64()), ("y", pa.float64()), ("heading", pa.float64()),
    ("speed", pa.float64()), ("lane", pa.int32()), ("lane_s", pa.float64()),
)  # fmt: skip
# What the planner meant to do; traces from before it was kept lack them.
_PLAN = ("plan_x", "plan_y")
_FIELDS: list[Any] = [
    *columns(pa.int32(), "step"),
    *columns(pa.float64(), "time"),
    *(pa.field(f"ego_{name}", kind, nullable=False) for name, kind in _EGO),
    *(pa.field(f"actor_{n}", pa.list_(*columns(k, "element")), nullable=False) for n, k in _ACTOR),
    *columns(pa.float64(), "acceleration", "steering", nullable=True),
    *columns(pa.list_(*columns(pa.float32(), "element")), *_PLAN, nullable=True),
]
SCHEMA = pa.schema(_FIELDS)
_KINDS: dict[pa.DataType, type] = {
    pa.bool_(): np.bool_,
    pa.int32(): np.int32,
    pa.float32(): np.float32,
    pa.float64(): np.float64,
}


@dataclass(frozen=True)
class Trace:
    """One episode as it was recorded.

    snapshots: one per tick, equal to those of the run; they share one actor table. commands: (n, 2)
    acceleration (m/s2) and steering (rad) that led from tick k to k + 1. target, others, needless, wrong_way,
    start_remaining_m: as in `EpisodeFacts`. plans: one per tick, (k, 2) where the planner meant to drive, None where it
    told nothing. told: when the planner was told which plates, where its eyes were not exact.
    """

    spec: ScenarioSpec
    planner: str
    outcome: Outcome
    error: str
    contact: Contact | None
    target: Verdict
    others: tuple[Verdict, ...]
    start_remaining_m: float
    snapshots: list[WorldSnapshot]
    commands: Array
    needless: tuple[Violation, ...] = ()
    wrong_way: tuple[Violation, ...] = ()
    plans: tuple[Plan | None, ...] = ()
    told: tuple[SignDetection, ...] = ()

    @property
    def events(self) -> list[Violation]:
        """What counts against the episode, in order of time."""
        return list(counted_against(self.target, self.needless, self.wrong_way))

    def routes(self, view: PlannerMap, scene: Scene) -> list[RouteView]:
        """The navigation view of every tick, found again by driving the same navigator along the trace."""
        navigator = Navigator(view.graph, destination_on_map(view, scene))
        return [navigator.update(ego_on_map(view, snapshot.ego)) for snapshot in self.snapshots]

    def facts(self, view: PlannerMap, scene: Scene) -> EpisodeFacts:
        """What the metrics are computed from, as it was at the end of the run."""
        return EpisodeFacts(
            scene=scene, snapshots=self.snapshots, route=self.routes(view, scene)[-1],
            start_remaining_m=self.start_remaining_m, outcome=self.outcome, contact=self.contact,
            target=self.target, others=self.others, needless=self.needless, wrong_way=self.wrong_way,
        )  # fmt: skip


def trace_of(result: EpisodeResult) -> Trace:
    """The trace of an episode that was just run. Raises ValueError for an episode without a tick."""
    facts = result.facts
    if facts is None or not facts.snapshots:
        raise ValueError(
            f"{result.spec.scenario_id}: an episode without a tick has no trace ({result.error})"
        )
    plans = plan_of_each_tick(result.plans, len(facts.snapshots))
    return Trace(
        result.spec, result.planner, result.outcome, result.error, facts.contact, facts.target, facts.others,
        facts.start_remaining_m, facts.snapshots, result.commands, facts.needless, facts.wrong_way, plans, result.told,
    )  # fmt: skip


def trace_path(run: Path, planner: str, scenario_id: str) -> Path:
    """Where the trace of an episode lies in a run folder; names become safe file names."""
    return run / "traces" / _file_name(planner) / f"{_file_name(scenario_id)}.parquet"


def find_trace(run: Path, episode: str) -> Path:
    """The trace of `scenario_id` or `planner/scenario_id` in a run folder.

    Raises InputError where there is none, naming a few that there are, and where several planners have one.
    """
    root = run / "traces"
    if not run.is_dir():
        raise InputError(f"{run}: no such run folder")
    if not root.is_dir():
        raise InputError(f"{run}: this run kept no traces (tsbench run --trace all)")
    planners = sorted(path.name for path in root.iterdir() if path.is_dir())
    planner, slash, scenario = episode.rpartition("/")
    if slash:
        path = trace_path(run, planner, scenario)
        if path.is_file():
            return path
    found = [name for name in planners if (root / name / f"{_file_name(episode)}.parquet").is_file()]
    if len(found) == 1:
        return root / found[0] / f"{_file_name(episode)}.parquet"
    if found:
        choices = ", ".join(f"{unquote(name)}/{episode}" for name in found)
        raise InputError(f"{run}: {episode} was driven by several planners, name one: {choices}")
    known = sorted(path for name in planners for path in (root / name).glob("*.parquet"))[:3]
    some = ", ".join(f"{unquote(path.parent.name)}/{unquote(path.stem)}" for path in known)
    raise InputError(
        f"{run}: no trace of {episode!r}" + (f"; there are {some}, …" if some else ": there is none at all")
    )


def _file_name(name: str) -> str:
    safe = quote(name, safe="")
    return safe.replace(".", "%2E") if not safe.strip(".") else safe


def write_trace(path: Path, result: EpisodeResult) -> None:
    """Write an episode's trace, all or nothing. Raises ValueError for an episode without a tick."""
    facts = result.facts
    if facts is None or not facts.snapshots:
        raise ValueError(f"{result.spec.scenario_id}: an episode without a tick has no trace")
    head = {
        "schema": TRACE_SCHEMA,
        "planner": result.planner,
        "scenario": _plain(asdict(result.spec)),
        "outcome": str(result.outcome),
        "error": one_line(result.error),
        "contact": None if facts.contact is None else asdict(facts.contact),
        "target": verdict_to_dict(facts.target),
        "others": [verdict_to_dict(v) for v in facts.others],
        "needless": [_plain(asdict(v)) for v in facts.needless],
        "wrong_way": [_plain(asdict(v)) for v in facts.wrong_way],
        "start_remaining_m": _plain(facts.start_remaining_m),
        "actors": _table_to_dict(facts.snapshots[-1].actors.table),
        # Of imperfect eyes only: what is exact stands in the scene.
        **({"told": [_plain(asdict(one)) for one in result.told]} if result.told else {}),
    }
    text = json.dumps(head, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    table = pa.table(_arrays(facts.snapshots, result.commands, result.plans), schema=SCHEMA)
    layout: dict[str, Any] = {"compression": "zstd", "use_dictionary": False, "write_page_checksum": True}
    with replacing(path) as part, pq.ParquetWriter(part, SCHEMA, **layout) as writer:
        writer.write_table(table, row_group_size=table.num_rows)
        # Not in the schema, which Parquet would store a second time.
        writer.add_key_value_metadata({_KEY: text, **OSM_LICENCE})


def plan_of_each_tick(plans: tuple[Plan | None, ...], ticks: int) -> tuple[Plan | None, ...]:
    return (*plans[:ticks], *[None] * (ticks - len(plans)))


def _arrays(
    snapshots: list[WorldSnapshot], commands: Array, plans: tuple[Plan | None, ...]
) -> dict[str, Any]:
    counts = [len(s.actors) for s in snapshots]
    offsets = np.concatenate(([0], np.cumsum(counts)))
    flat: dict[str, list[npt.NDArray[Any]]] = {
        "index": [s.actors.index for s in snapshots],
        "speed": [s.actors.speed for s in snapshots],
        "lane": [s.actors.lane for s in snapshots],
        "lane_s": [s.actors.lane_s for s in snapshots],
        "x": [s.actors.pose[:, 0] for s in snapshots],
        "y": [s.actors.pose[:, 1] for s in snapshots],
        "heading": [s.actors.pose[:, 2] for s in snapshots],
    }
    arrays: dict[str, Any] = {
        "step": _numbers([s.step for s in snapshots], pa.int32()),
        "time": _numbers([s.time for s in snapshots], pa.float64()),
    }
    for name, kind in _EGO:
        arrays[f"ego_{name}"] = _numbers([getattr(s.ego, name) for s in snapshots], kind)
    for name, kind in _ACTOR:
        arrays[f"actor_{name}"] = _lists(f"actor_{name}", offsets, _numbers(np.concatenate(flat[name]), kind))
    # The planner may have failed before its last command took effect: no more commands than steps are kept.
    kept = commands[: len(snapshots)]
    for k, name in enumerate(("acceleration", "steering")):
        missing = pa.nulls(len(snapshots) - len(kept), pa.float64())
        arrays[name] = pa.concat_arrays([_numbers(kept[:, k], pa.float64()), missing])
    told = plan_of_each_tick(plans, len(snapshots))
    offsets = np.concatenate(([0], np.cumsum([0 if plan is None else len(plan) for plan in told])))
    points = np.concatenate([np.empty((0, 2)), *(plan[:, :2] for plan in told if plan is not None)])
    there = np.array([plan is not None for plan in told])
    for k, name in enumerate(_PLAN):
        arrays[name] = _lists(name, offsets, _numbers(points[:, k], pa.float32()), there)
    return arrays


# From buffers: `pa.array` would import pandas in each process that drives, which takes longer than an episode.
def _numbers(values: npt.ArrayLike, kind: pa.DataType) -> pa.Array:
    plain: npt.NDArray[Any] = np.ascontiguousarray(values, dtype=_KINDS[kind])
    packed = np.packbits(plain, bitorder="little") if kind == pa.bool_() else plain
    return pa.Array.from_buffers(kind, len(plain), [None, pa.py_buffer(packed)])


def _lists(
    name: str, offsets: Array, values: pa.Array, there: npt.NDArray[np.bool_] | None = None
) -> pa.Array:
    """A column of lists. offsets: where each begins, and the last one's end. there: which are not null, None: all."""
    known = None if there is None else pa.py_buffer(np.packbits(there, bitorder="little"))
    starts = pa.py_buffer(np.ascontiguousarray(offsets, dtype=np.int32))
    return pa.Array.from_buffers(
        SCHEMA.field(name).type, len(offsets) - 1, [known, starts], children=[values]
    )


def read_trace(path: Path) -> Trace:
    """Read a trace. Raises InputError (one line) for anything that is not a whole trace of this schema."""
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            head = (file.metadata.metadata or {}).get(_KEY.encode())
            check_size(file, path)
            table = file.read(use_threads=False)
    except FileNotFoundError:
        raise InputError(f"{path}: no such trace") from None
    except (pa.ArrowException, OSError) as error:
        raise InputError(f"{path}: cannot be read as a trace ({one_line(str(error))})") from None
    if head is None:
        raise InputError(f"{path}: a Parquet file, but no trace of tsbench")
    try:
        meta = json.loads(head)
        if meta["schema"] != TRACE_SCHEMA:
            raise InputError(
                f"{path}: trace of schema {meta['schema']}, this tsbench reads schema {TRACE_SCHEMA}"
            )
        for name in _PLAN:
            if name not in table.column_names:
                table = table.append_column(SCHEMA.field(name), pa.nulls(len(table), SCHEMA.field(name).type))
        return _trace(meta, table.cast(SCHEMA).combine_chunks())
    except (KeyError, TypeError, ValueError, IndexError, RecursionError, pa.ArrowException) as error:
        raise InputError(
            f"{path}: malformed trace ({type(error).__name__}: {one_line(str(error))})"
        ) from None


def _trace(meta: Mapping[str, Any], table: Any) -> Trace:
    if not table.num_rows:
        raise ValueError("no ticks")
    snapshots = _snapshots(table, _table_from_dict(meta["actors"]))
    known = table.num_rows - table["acceleration"].null_count
    commands = np.column_stack([table[n].slice(0, known).to_numpy() for n in ("acceleration", "steering")])
    return Trace(
        spec=dataclass_from_json(ScenarioSpec, meta["scenario"]),
        planner=str(meta["planner"]),
        outcome=Outcome(meta["outcome"]),
        error=str(meta["error"]),
        contact=None if meta["contact"] is None else dataclass_from_json(Contact, meta["contact"]),
        target=dataclass_from_json(Verdict, meta["target"]),
        others=tuple(dataclass_from_json(Verdict, verdict) for verdict in meta["others"]),
        start_remaining_m=float(meta["start_remaining_m"]),
        snapshots=snapshots,
        commands=commands.astype(np.float64, copy=False),
        # Traces from before contrast scenes have none.
        needless=tuple(dataclass_from_json(Violation, event) for event in meta.get("needless", ())),
        # Those of editions before 2026.3 have none.
        wrong_way=tuple(dataclass_from_json(Violation, event) for event in meta.get("wrong_way", ())),
        plans=_plans(table),
        told=tuple(dataclass_from_json(SignDetection, one) for one in meta.get("told", ())),
    )


def _plans(table: Any) -> tuple[Plan | None, ...]:
    xs, ys = (table[name].to_pylist() for name in _PLAN)
    return tuple(
        None if x is None else np.array((x, y), dtype=np.float32).T for x, y in zip(xs, ys, strict=True)
    )


def _snapshots(table: Any, actors: ActorTable) -> list[WorldSnapshot]:
    lists = {name: table[f"actor_{name}"].chunk(0) for name, _ in _ACTOR}
    at = lists["index"].offsets.to_pylist()
    if any(lists[name].offsets.to_pylist() != at for name in lists):
        raise ValueError("actor columns of unequal length")
    flat = {name: column.values.to_numpy() for name, column in lists.items()}
    index, lane = flat["index"], flat["lane"]
    if len(index) and (int(index.min()) < 0 or int(index.max()) >= len(actors.ids)):
        raise ValueError("an actor that is not in the actor table")
    pose = np.column_stack([flat[n] for n in ("x", "y", "heading")])
    pose.flags.writeable = False
    egos = [EgoState(*row) for row in zip(*(table[f"ego_{n}"].to_pylist() for n, _ in _EGO), strict=True)]
    steps, times = table["step"].to_pylist(), table["time"].to_pylist()
    return [
        WorldSnapshot(
            steps[k],
            times[k],
            egos[k],
            Actors(actors, index[a:b], pose[a:b], flat["speed"][a:b], lane[a:b], flat["lane_s"][a:b]),
        )
        for k, (a, b) in enumerate(pairwise(at))
    ]


def verdict_to_dict(verdict: Verdict) -> dict[str, Any]:
    """A verdict as plain JSON values; non-finite numbers as text."""
    result: dict[str, Any] = _plain(asdict(verdict))
    return result


def _table_to_dict(table: ActorTable) -> dict[str, Any]:
    n = len(table.ids)
    return {
        "id": table.ids,
        "kind": table.kind[:n].tolist(),
        "length": table.length[:n].tolist(),
        "width": table.width[:n].tolist(),
        "route": [" ".join(route) for route in table.routes],
    }


def _table_from_dict(data: Mapping[str, Any]) -> ActorTable:
    names = ("id", "kind", "length", "width", "route")
    table = ActorTable(capacity=max(len(data["id"]), 1))
    for actor, kind, length, width, route in zip(*(data[n] for n in names), strict=True):
        table.add(str(actor), ActorKind(kind), float(length), float(width), tuple(route.split()))
    return table


def _plain(value: Any) -> Any:
    """Values for JSON: NaN and infinities, which it does not have, become text."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, float):
        value = float(value)
        return value if np.isfinite(value) else repr(value)
    return value.item() if isinstance(value, np.generic) else value
