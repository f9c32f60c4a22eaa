"""`episodes.parquet` as arrays for aggregation, checked: what is missing or contradictory has a name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from tsbench.core.errors import InputError
from tsbench.episode.outcome import Outcome
from tsbench.geometry.polyline import Array
from tsbench.metrics.episode import METRICS, SCD
from tsbench.signs.model import GROUPS

_TEXT = ("planner", "scenario_id", "scenario_type", "group", "map_id", "outcome")
_FIGURES = {metric.column: metric for metric in (SCD, *METRICS.values())}


@dataclass(frozen=True)
class Records:
    """Records of one planner, sorted by scenario.

    kinds: scenario types, sorted by name, and groups: the group of each. kind: (n,) index into them.
    map_code: (n,) equal for episodes on one map. outcomes: (n,). error: (n,) is the outcome an error? values:
    per column (n,) float64, NaN where the record has none.
    """

    kinds: tuple[str, ...]
    groups: tuple[str, ...]
    kind: npt.NDArray[np.intp]
    map_code: npt.NDArray[np.intp]
    outcomes: tuple[str, ...]
    error: npt.NDArray[np.bool_]
    values: Mapping[str, Array]

    def __len__(self) -> int:
        return len(self.kind)

    def type_groups(self) -> dict[str, str]:
        """The group of each type; groups in the catalogue's order, types by name within each."""
        group_of = dict(zip(self.kinds, self.groups, strict=True))
        return {
            kind: group_of[kind]
            for kind in sorted(group_of, key=lambda kind: (group_rank(group_of[kind]), kind))
        }

    def panels(self) -> dict[str, npt.NDArray[np.bool_]]:
        """(n,) the episodes of each group, and of all of them under ""."""
        groups = np.array(self.groups)[self.kind]
        of_groups = {group: groups == group for group in dict.fromkeys(self.type_groups().values())}
        return {"": np.ones(len(self), dtype=bool), **of_groups}


def group_rank(group: str) -> tuple[int, str]:
    """Sorts groups as the catalogue does, others behind."""
    return (GROUPS.index(group) if group in GROUPS else len(GROUPS)), group


def split_records(episodes: pa.Table) -> dict[str, Records]:
    """Records by planner, in the order of the planners' names. Raises InputError."""
    columns = (*_TEXT, *_FIGURES)
    missing = [name for name in columns if name not in episodes.column_names]
    if missing:
        raise InputError(f"episode records: no column {', '.join(missing)}")
    episodes = episodes.select(columns)
    episodes = episodes.sort_by([("planner", "ascending"), ("scenario_id", "ascending")])
    names = _strings(episodes, "planner")
    for a, b in pairwise(zip(names, _strings(episodes, "scenario_id"), strict=True)):
        if a == b:
            raise InputError(f"episode records: {a[0]}, {a[1]}: recorded twice")
    return {
        planner: _records(planner, episodes.slice(names.index(planner), names.count(planner)))
        for planner in dict.fromkeys(names)
    }


def _strings(table: Any, column: str) -> list[str]:
    values: list[str] = table[column].to_pylist()
    return values


def _records(planner: str, table: Any) -> Records:
    scenarios, outcomes = _strings(table, "scenario_id"), _strings(table, "outcome")
    known = {outcome.value: outcome.is_error for outcome in Outcome}
    strange = [o for o in outcomes if o not in known]
    if strange:
        raise InputError(f"episode records: {planner}: unknown outcome {strange[0]!r}")
    error = np.array([known[o] for o in outcomes], dtype=bool)
    values = {}
    for column in _FIGURES:
        numbers = table[column].cast(pa.float64()).to_numpy(zero_copy_only=False)
        values[column] = np.asarray(numbers, dtype=np.float64)
    for column in (c for c, metric in _FIGURES.items() if metric.failure is not None):
        holes = np.nonzero(np.isnan(values[column]) & ~error)[0]
        if len(holes):
            where = scenarios[holes[0]]
            raise InputError(f"episode records: {planner}, {where}: completed, but without {column}")
    group_of = dict(zip(_strings(table, "scenario_type"), _strings(table, "group"), strict=True))
    kinds, kind = np.unique(np.array(_strings(table, "scenario_type")), return_inverse=True)
    _, map_code = np.unique(np.array(_strings(table, "map_id")), return_inverse=True)
    return Records(
        kinds=tuple(kinds.tolist()), groups=tuple(group_of[k] for k in kinds.tolist()), kind=kind,
        map_code=map_code, outcomes=tuple(outcomes), error=error, values=values,
    )  # fmt: skip
