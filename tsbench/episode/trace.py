"""Traces: every tick of one episode as one Parquet file, `RUN/traces/<planner>/<scenario_id>.parquet`.

A row is a tick; what does not change stands as JSON in the file's metadata. Floats come back bit for bit, so
that a monitor that reads a trace says exactly what it said during the run; the same episode gives the same
bytes.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import quote

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tsbench.core.errors import InputError
from tsbench.core.files import replacing
from tsbench.core.parquet import OSM_LICENCE, check_size
from tsbench.core.text import one_line
from tsbench.core.typed import typed
from tsbench.episode.observer import destination_on_map, ego_on_map
from tsbench.episode.outcome import Contact, Course, EpisodeFacts, EpisodeResult, Outcome
from tsbench.episode.perception import SignDetection
from tsbench.episode.trace_columns import PLAN, SCHEMA, plan_of_each_tick, plans_of, snapshots_of, table_of
from tsbench.geometry.polyline import Array
from tsbench.planners.base import Plan
from tsbench.roads.planner_map import PlannerMap
from tsbench.rules.monitor import Verdict, Verdicts, Violation
from tsbench.scenarios.spec import MOST_TICKS, ScenarioSpec
from tsbench.sim.navigation import Navigator, RouteView
from tsbench.sim.scene import Scene
from tsbench.sim.world import ActorKind, ActorTable

if TYPE_CHECKING:
    # Reading a trace needs no SUMO.
    from _typeshed import DataclassInstance

    from tsbench.episode.episode import Episode

TRACE_SCHEMA = 1
_KEY = "tsbench.trace"
# Unpacked: far more than any of ours has.
_MOST_BYTES = 1 << 29
_Kind = TypeVar("_Kind")


@dataclass(frozen=True, kw_only=True)
class Trace(Course):
    """One episode as it was recorded; its snapshots share one actor table.

    commands: (n, 2) acceleration (m/s2) and steering (rad) that led from tick k to k + 1. plans: one per tick, (k, 2)
    where the planner meant to drive, None where it told nothing. told: when the planner was told which plates, where
    its eyes were not exact.
    """

    spec: ScenarioSpec
    planner: str
    error: str
    commands: Array
    plans: tuple[Plan | None, ...] = ()
    told: tuple[SignDetection, ...] = ()

    @classmethod
    def so_far(cls, episode: Episode) -> Trace:
        """An episode up to its present tick, for pictures; an excursion that goes on is no event yet."""
        m, over = episode.monitors, episode.result
        return cls(
            spec=episode.spec,
            planner=episode.planner,
            outcome=Outcome.TIMEOUT if over is None else over.outcome,
            error="" if over is None else over.error,
            contact=None,
            verdicts=m.verdicts(),
            start_remaining_m=episode.start_remaining,
            snapshots=list(episode.snapshots),
            commands=np.array(episode.commands, np.float64).reshape(-1, 2),
            plans=plan_of_each_tick(tuple(episode.plans), len(episode.snapshots)),
            told=tuple(episode.observer.told),
        )

    def routes(self, view: PlannerMap, scene: Scene) -> list[RouteView]:
        """The navigation view of every tick, found again by driving the same navigator along the trace."""
        navigator = Navigator(view.graph, destination_on_map(view, scene))
        return [navigator.update(ego_on_map(view, snapshot.ego)) for snapshot in self.snapshots]

    def facts(self, view: PlannerMap, scene: Scene) -> EpisodeFacts:
        """What the metrics are computed from, as it was at the end of the run."""
        return EpisodeFacts(scene=scene, route=self.routes(view, scene)[-1], **self.course())


def trace_of(result: EpisodeResult) -> Trace:
    """The trace of an episode that was just run. Raises ValueError for an episode without a tick."""
    facts = result.facts
    if facts is None or not facts.snapshots:
        raise ValueError(f"{result.spec.scenario_id}: an episode without a tick has no trace ({result.error})")
    return Trace(
        **facts.course(),
        spec=result.spec,
        planner=result.planner,
        error=result.error,
        commands=result.commands,
        plans=plan_of_each_tick(result.plans, len(facts.snapshots)),
        told=result.told,
    )


def trace_path(run: Path, planner: str, scenario_id: str) -> Path:
    """Where the trace of an episode lies in a run folder; names become safe file names."""
    return run / "traces" / _file_name(planner) / f"{_file_name(scenario_id)}.parquet"


def _file_name(name: str) -> str:
    safe = quote(name, safe="")
    return safe.replace(".", "%2E") if not safe.strip(".") else safe


def write_trace(path: Path, result: EpisodeResult) -> None:
    """Write an episode's trace, all or nothing. Raises ValueError for an episode without a tick."""
    facts = result.facts
    if facts is None or not facts.snapshots:
        raise ValueError(f"{result.spec.scenario_id}: an episode without a tick has no trace")
    first, *more = facts.verdicts.targets
    head = {
        "schema": TRACE_SCHEMA,
        "planner": result.planner,
        "scenario": to_dict(result.spec),
        "outcome": str(result.outcome),
        "error": one_line(result.error),
        "contact": None if facts.contact is None else asdict(facts.contact),
        "target": to_dict(first),
        **({"more_targets": [to_dict(v) for v in more]} if more else {}),
        "others": [to_dict(v) for v in facts.verdicts.others],
        "needless": [to_dict(v) for v in facts.verdicts.needless],
        "wrong_way": [to_dict(v) for v in facts.verdicts.wrong_way],
        "start_remaining_m": _plain(facts.start_remaining_m),
        "actors": _table_to_dict(facts.snapshots[-1].actors.table),
        # Of imperfect eyes only: what is exact stands in the scene.
        **({"told": [to_dict(one) for one in result.told]} if result.told else {}),
    }
    text = json.dumps(head, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    table = table_of(facts.snapshots, result.commands, result.plans)
    layout: dict[str, Any] = {"compression": "zstd", "use_dictionary": False, "write_page_checksum": True}
    with replacing(path) as part, pq.ParquetWriter(part, SCHEMA, **layout) as writer:
        writer.write_table(table, row_group_size=table.num_rows)
        # Not in the schema, which Parquet would store a second time.
        writer.add_key_value_metadata({_KEY: text, **OSM_LICENCE})


def read_trace(path: Path) -> Trace:
    """Read a trace. Raises InputError (one line) for anything that is not a whole trace of this schema.

    Nothing is unpacked of a file that says it has more ticks than its scenario.
    """
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            check_size(file, path, MOST_TICKS + 1, _MOST_BYTES)
            meta = _head(file, path)
            table = file.read(use_threads=False)
    except FileNotFoundError:
        raise InputError(f"{path}: no such trace") from None
    except (pa.ArrowException, OSError) as error:
        raise InputError(f"{path}: cannot be read as a trace ({one_line(str(error))})") from None
    with _malformed(path):
        for name in PLAN:
            if name not in table.column_names:
                table = table.append_column(SCHEMA.field(name), pa.nulls(len(table), SCHEMA.field(name).type))
        return _trace(meta, table.cast(SCHEMA).combine_chunks())


def _head(file: pq.ParquetFile, path: Path) -> dict[str, Any]:
    """What a trace says of its whole episode."""
    head = (file.metadata.metadata or {}).get(_KEY.encode())
    if head is None:
        raise InputError(f"{path}: a Parquet file, but no trace of tsbench")
    with _malformed(path):
        meta: dict[str, Any] = json.loads(head)
        if meta["schema"] != TRACE_SCHEMA:
            raise InputError(
                f"{path}: trace of schema {meta['schema']!r:.20}, this tsbench reads schema {TRACE_SCHEMA}"
            )
        horizon = typed(ScenarioSpec, meta["scenario"], strict=False).horizon
    if file.metadata.num_rows > horizon + 1:
        raise InputError(f"{path}: {file.metadata.num_rows} ticks, of a scenario that ends after {horizon}")
    return meta


@contextmanager
def _malformed(path: Path) -> Iterator[None]:
    try:
        yield
    except (KeyError, TypeError, ValueError, IndexError, RecursionError, pa.ArrowException) as error:
        raise InputError(f"{path}: malformed trace ({type(error).__name__}: {one_line(str(error))})") from None


def _trace(meta: Mapping[str, Any], table: Any) -> Trace:
    if not table.num_rows:
        raise ValueError("no ticks")
    snapshots = snapshots_of(table, _table_from_dict(meta["actors"]))
    known = table.num_rows - table["acceleration"].null_count
    # A null is NaN.
    commands = [table[name].slice(0, known).to_pylist() for name in ("acceleration", "steering")]
    return Trace(
        spec=typed(ScenarioSpec, meta["scenario"], strict=False),
        planner=str(meta["planner"]),
        outcome=Outcome(meta["outcome"]),
        error=str(meta["error"]),
        contact=None if meta["contact"] is None else typed(Contact, meta["contact"], strict=False),
        verdicts=Verdicts(
            _typed(Verdict, [meta["target"], *meta.get("more_targets", ())]),
            _typed(Verdict, meta["others"]),
            # Traces from before contrast scenes have none.
            _typed(Violation, meta.get("needless", ())),
            # Those of editions before 2026.3 have none.
            _typed(Violation, meta.get("wrong_way", ())),
        ),
        start_remaining_m=float(meta["start_remaining_m"]),
        snapshots=snapshots,
        commands=np.array(commands, dtype=np.float64).T.copy(),
        plans=plans_of(table),
        told=_typed(SignDetection, meta.get("told", ())),
    )


def _typed(kind: type[_Kind], found: Iterable[Any]) -> tuple[_Kind, ...]:
    return tuple(typed(kind, one, strict=False) for one in found)


def to_dict(value: DataclassInstance) -> dict[str, Any]:
    """A verdict, an event or the like as plain JSON values; non-finite numbers as text."""
    result: dict[str, Any] = _plain(asdict(value))
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
