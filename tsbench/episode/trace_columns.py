"""The columns of a trace: from what was seen and done at each tick to arrays of Arrow, and back, bit for bit."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from tsbench.core.parquet import columns, fields_of
from tsbench.geometry.polyline import Array
from tsbench.planners.base import Plan
from tsbench.sim.world import Actors, ActorTable, EgoState, WorldSnapshot

_EGO = tuple((column.name, column.type) for column in fields_of(EgoState))
_MOTION = tuple((name, pa.float64()) for name in ("x", "y", "heading", "speed"))
_ACTOR = (("index", pa.int32()), *_MOTION, ("lane", pa.int32()), ("lane_s", pa.float64()))
# What the planner meant to do; traces from before it was kept lack them.
PLAN = ("plan_x", "plan_y")
_FIELDS: list[Any] = [
    *columns(pa.int32(), "step"),
    *columns(pa.float64(), "time"),
    *(pa.field(f"ego_{name}", kind, nullable=False) for name, kind in _EGO),
    *(pa.field(f"actor_{n}", pa.list_(*columns(k, "element")), nullable=False) for n, k in _ACTOR),
    *columns(pa.float64(), "acceleration", "steering", nullable=True),
    *columns(pa.list_(*columns(pa.float32(), "element")), *PLAN, nullable=True),
]
SCHEMA = pa.schema(_FIELDS)
_KINDS: dict[pa.DataType, type] = {
    pa.bool_(): np.bool_,
    pa.int32(): np.int32,
    pa.float32(): np.float32,
    pa.float64(): np.float64,
}


def plan_of_each_tick(plans: tuple[Plan | None, ...], ticks: int) -> tuple[Plan | None, ...]:
    """As many as there are ticks: what a planner told after the last one is left out, None where it told nothing."""
    return (*plans[:ticks], *[None] * (ticks - len(plans)))


def table_of(snapshots: list[WorldSnapshot], commands: Array, plans: tuple[Plan | None, ...]) -> pa.Table:
    """A row for each tick, by `SCHEMA`. plans: of the first ticks; None where the planner told nothing."""
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
    points = np.concatenate([np.empty((0, 2), np.float32), *(plan[:, :2] for plan in told if plan is not None)])
    there = np.array([plan is not None for plan in told])
    for k, name in enumerate(PLAN):
        arrays[name] = _lists(name, offsets, _numbers(points[:, k], pa.float32()), there)
    return pa.table(arrays, schema=SCHEMA)


# From buffers: `pa.array`, like `DataType.to_pandas_dtype`, would import pandas in each process that drives. That takes
# longer than an episode.
def _numbers(values: npt.ArrayLike, kind: pa.DataType) -> pa.Array:
    plain: npt.NDArray[Any] = np.ascontiguousarray(values, dtype=_KINDS[kind])
    packed = np.packbits(plain, bitorder="little") if kind == pa.bool_() else plain
    return pa.Array.from_buffers(kind, len(plain), [None, pa.py_buffer(packed)])


def _lists(name: str, offsets: Array, values: pa.Array, there: npt.NDArray[np.bool_] | None = None) -> pa.Array:
    """A column of lists. offsets: where each begins, and the last one's end. there: which are not null, None: all."""
    known = None if there is None else pa.py_buffer(np.packbits(there, bitorder="little"))
    starts = pa.py_buffer(np.ascontiguousarray(offsets, dtype=np.int32))
    return pa.Array.from_buffers(SCHEMA.field(name).type, len(offsets) - 1, [known, starts], children=[values])


def plans_of(table: pa.Table) -> tuple[Plan | None, ...]:
    """Where the planner meant to drive at each tick, (k, 2) m; None where it told nothing."""
    xs, ys = (table[name].to_pylist() for name in PLAN)
    return tuple(None if x is None else np.array((x, y), dtype=np.float32).T for x, y in zip(xs, ys, strict=True))


def snapshots_of(table: pa.Table, actors: ActorTable) -> list[WorldSnapshot]:
    """What was at each tick. Raises ValueError for columns that contradict each other."""
    lists = {name: table[f"actor_{name}"].chunk(0) for name, _ in _ACTOR}
    at = lists["index"].offsets.to_pylist()
    if any(lists[name].offsets.to_pylist() != at for name in lists):
        raise ValueError("actor columns of unequal length")
    # By DLPack: Arrow's own `to_numpy` would import pandas.
    flat: dict[str, Any] = {name: np.from_dlpack(column.values) for name, column in lists.items()}
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
