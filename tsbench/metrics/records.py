"""`episodes.parquet` as arrays for aggregation, checked: what is missing or contradictory has a name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from tsbench.core.errors import InputError
from tsbench.episode.outcome import Outcome
from tsbench.geometry.polyline import Array
from tsbench.metrics.episode_metrics import METRICS
from tsbench.metrics.scd import CONTRASTED, PAIRED, SCD, SQUARED
from tsbench.scenarios.spec import CONTRAST, HALVES, SECOND_PAIR, pair_type
from tsbench.signs.model import GROUPS

_TEXT = ("planner", "scenario_id", "scenario_type", "group", "map_id", "outcome", "pair_id", "half", "place")
_FIGURES = {metric.column: metric for metric in (SCD, *METRICS.values())}
_Codes = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Records:
    """Records of one planner, sorted by scenario: one for each of n episodes, or for each of n pairs.

    scenarios: (n,) ids, of pairs that of the signed half. kinds: scenario types, sorted by name, of both halves of a
    pair that of the pair; groups: the group of each. kind: (n,) index into them. place: (n,) equal for what is at one
    place; placed: all places are known, otherwise a map counts as one. outcomes: (n,). error: (n,) is the outcome an
    error? contrast: (n,) is it a contrast half? values: per column (n,) float64, NaN where the record has none.
    partner: (n,) the other half's number, -1 where it has no record.
    """

    scenarios: tuple[str, ...]
    kinds: tuple[str, ...]
    groups: tuple[str, ...]
    kind: _Codes
    place: _Codes
    placed: bool
    outcomes: tuple[str, ...]
    error: npt.NDArray[np.bool_]
    contrast: npt.NDArray[np.bool_]
    partner: _Codes
    values: Mapping[str, Array]

    def __len__(self) -> int:
        return len(self.kind)

    def take(self, rows: _Codes) -> Records:
        """Some records, in this order; types without one are left out, and so are partners."""
        kept, kind = np.unique(self.kind[rows], return_inverse=True)
        return Records(
            scenarios=tuple(self.scenarios[k] for k in rows), kinds=tuple(self.kinds[k] for k in kept),
            groups=tuple(self.groups[k] for k in kept), kind=kind, place=self.place[rows], placed=self.placed,
            outcomes=tuple(self.outcomes[k] for k in rows), error=self.error[rows], contrast=self.contrast[rows],
            partner=np.full(len(rows), -1), values={name: column[rows] for name, column in self.values.items()},
        )  # fmt: skip

    def of(self, part: str) -> Records:
        """The records that a figure of SCD is over: of squares, pairs, signed or contrast halves."""
        if part == SQUARED:
            pairs = self.of(PAIRED)
            number = {name: k for k, name in enumerate(pairs.scenarios)}
            firsts = [k for name, k in number.items() if name + SECOND_PAIR in number]
            seconds = [number[pairs.scenarios[k] + SECOND_PAIR] for k in firsts]
            return pairs.take(np.array(firsts, np.intp))._with(pairs.take(np.array(seconds, np.intp)))
        if part != PAIRED:
            return self.take(np.flatnonzero(self.contrast == (part == CONTRASTED)))
        rows = np.flatnonzero(~self.contrast & (self.partner >= 0))
        return self.take(rows)._with(self.take(self.partner[rows]))

    def _with(self, others: Records) -> Records:
        """Each passed where the other is, too, and NaN where either has none: SCD alone."""
        scd = np.minimum(self.values[SCD.column], others.values[SCD.column])
        return replace(self, error=self.error | others.error, values={SCD.column: scd})

    def type_groups(self) -> dict[str, str]:
        """The group of each type; groups in the catalogue's order, types by name within each."""
        group_of = dict(zip(self.kinds, self.groups, strict=True))
        return {kind: group_of[kind] for kind in sorted(group_of, key=lambda kind: (group_rank(group_of[kind]), kind))}

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
    # Arrow's own way to numpy would import pandas, which takes longer than many an episode. None is NaN.
    values = {column: np.array(table[column].to_pylist(), dtype=np.float64) for column in _FIGURES}
    for column in (c for c, metric in _FIGURES.items() if metric.failure is not None):
        holes = np.nonzero(np.isnan(values[column]) & ~error)[0]
        if len(holes):
            where = scenarios[holes[0]]
            raise InputError(f"episode records: {planner}, {where}: completed, but without {column}")
    halves = np.array(_strings(table, "half"))
    contrast = halves == CONTRAST
    if not np.isin(halves, HALVES).all():
        raise InputError(f"episode records: {planner}: a half that is none of {', '.join(HALVES)}")
    pair_ids, types = _strings(table, "pair_id"), _strings(table, "scenario_type")
    pair_types = [pair_type(pair, kind) for pair, kind in zip(pair_ids, types, strict=True)]
    # The group of a pair is that of its signed half, which comes last.
    order = np.argsort(~contrast, kind="stable")
    named = list(zip(pair_types, _strings(table, "group"), strict=True))
    group_of = dict(named[k] for k in order)
    kinds, kind = np.unique(np.array(pair_types), return_inverse=True)
    places = _strings(table, "place")
    at = [place or f"map {one}" for place, one in zip(places, _strings(table, "map_id"), strict=True)]
    return Records(
        scenarios=tuple(scenarios), kinds=tuple(kinds.tolist()), groups=tuple(group_of[k] for k in kinds.tolist()),
        kind=kind, place=np.unique(np.array(at), return_inverse=True)[1], placed=all(places),
        outcomes=tuple(outcomes), error=error, contrast=contrast,
        partner=_partners(planner, pair_ids, contrast, scenarios), values=values,
    )  # fmt: skip


def _partners(planner: str, pair_ids: list[str], contrast: npt.NDArray[np.bool_], scenarios: list[str]) -> _Codes:
    first: dict[str, int] = {}
    partner = np.full(len(pair_ids), -1)
    for k, pair in enumerate(pair_ids):
        other = first.setdefault(pair, k) if pair else k
        if other == k:
            continue
        if partner[other] >= 0 or contrast[other] == contrast[k]:
            raise InputError(f"episode records: {planner}, {scenarios[k]}: pair {pair} has this half more than once")
        partner[[other, k]] = k, other
    return partner
