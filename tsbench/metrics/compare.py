"""Two planners compared scenario by scenario: what changed by type and group, and which scenarios flipped.

Source: docs/spec/metrics.md, "Aggregation". As everywhere, strict and completed figures go together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from tsbench.core.errors import InputError
from tsbench.metrics.intervals import ClusterBootstrap
from tsbench.metrics.paired import Difference, Pairs, adjust, difference
from tsbench.metrics.records import METRICS, SCD, MetricColumn, Records, split_records

_SAME = ("scenario_id", "scenario_type", "group", "map_id")
_SHOWN = {"outcome": "outcome", "clause": "violation_clause", "error": "error"}


@dataclass(frozen=True, slots=True)
class PairedFigure:
    """One difference twice.

    strict: over every pair, None for metrics without a value for a failure; completed: over the pairs of which
    neither episode has an error outcome.
    """

    strict: Difference | None
    completed: Difference

    @property
    def main(self) -> Difference:
        """The strict one where there is one."""
        return self.completed if self.strict is None else self.strict


@dataclass(frozen=True, slots=True)
class Flip:
    """A scenario that one of the two has as SCD and the other has not. won: it is B that has it.

    clause_*: first clause of the target rule that was broken; error_*: cause of an error outcome; None if none.
    """

    scenario_id: str
    scenario_type: str
    group: str
    map_id: str
    won: bool
    outcome_a: str
    clause_a: str | None
    error_a: str | None
    outcome_b: str
    clause_b: str | None
    error_b: str | None


@dataclass(frozen=True)
class Comparison:
    """B against A. overall, groups: macro SCD; types: SCD, Holm over them; metrics: episode-weighted.

    flips: lost ones first, then by type and scenario.
    """

    overall: PairedFigure
    groups: Mapping[str, PairedFigure]
    types: Mapping[str, PairedFigure]
    type_groups: Mapping[str, str]
    metrics: Mapping[str, PairedFigure]
    flips: tuple[Flip, ...]
    pairs: int
    completed: int


def compare(a: pa.Table, b: pa.Table, seed: str) -> Comparison:
    """Compare two planners' episode records of the same scenarios. seed: of the bootstrap, the contract hash.

    Raises InputError where records are malformed, or are not of the same scenarios.
    """
    a, b = (table.sort_by("scenario_id") for table in (a, b))
    for column in _SAME:
        for scenario, x, y in zip(
            a["scenario_id"].to_pylist(), a[column].to_pylist(), b[column].to_pylist(), strict=True
        ):
            if x != y:
                raise InputError(
                    f"scenario {scenario}: {column} is {x!r} in A and {y!r} in B: not comparable"
                )
    (left,), (right,) = (split_records(table).values() for table in (a, b))
    figure = partial(_figure, ClusterBootstrap(seed), left, right)
    group_of = left.type_groups()
    everyone = np.ones(len(left), dtype=bool)
    inside = {g: np.array([x == g for x in left.groups])[left.kind] for g in dict.fromkeys(group_of.values())}
    types = {kind: figure(f"type {kind}", SCD, left.kind == left.kinds.index(kind)) for kind in group_of}
    return Comparison(
        overall=figure("overall", SCD, everyone, macro=True),
        groups={group: figure(f"group {group}", SCD, use, macro=True) for group, use in inside.items()},
        types=_adjusted(types),
        type_groups=group_of,
        metrics={name: figure("overall", column, everyone) for name, column in METRICS.items()},
        flips=_flips(a, b),
        pairs=len(left),
        completed=int(np.count_nonzero(~left.error & ~right.error)),
    )


def _figure(
    bootstrap: ClusterBootstrap,
    a: Records,
    b: Records,
    label: str,
    metric: MetricColumn,
    use: npt.NDArray[np.bool_],
    macro: bool = False,
) -> PairedFigure:
    x, y = a.values[metric.column], b.values[metric.column]
    whole = use & ~a.error & ~b.error & ~np.isnan(x) & ~np.isnan(y)

    def between(
        x: npt.NDArray[np.float64], y: npt.NDArray[np.float64], use: npt.NDArray[np.bool_]
    ) -> Difference:
        pairs = Pairs(x[use], y[use], a.map_code[use], a.kind[use], len(a.kinds))
        return difference(bootstrap, label, pairs, metric, macro)

    completed = between(x, y, whole)
    if metric.failure is None:
        return PairedFigure(None, completed)
    if not (use & (a.error | b.error)).any():
        return PairedFigure(completed, completed)
    x, y = np.where(a.error, metric.failure, x), np.where(b.error, metric.failure, y)
    return PairedFigure(between(x, y, use), completed)


def _adjusted(types: Mapping[str, PairedFigure]) -> dict[str, PairedFigure]:
    """Holm over the strict figures, and over the completed ones."""
    strict = adjust({kind: figure.main for kind, figure in types.items()}, SCD.scale)
    completed = adjust({kind: figure.completed for kind, figure in types.items()}, SCD.scale)
    return {kind: PairedFigure(strict[kind], completed[kind]) for kind in types}


def _flips(a: pa.Table, b: pa.Table) -> tuple[Flip, ...]:
    columns = [*_SAME, "scd", *_SHOWN.values()]
    found = []
    for x, y in zip(a.select(columns).to_pylist(), b.select(columns).to_pylist(), strict=True):
        if bool(x["scd"]) != bool(y["scd"]):
            what = {name: x[name] for name in _SAME} | {"won": bool(y["scd"])}
            what |= {
                f"{name}_{side}": row[c] for side, row in (("a", x), ("b", y)) for name, c in _SHOWN.items()
            }
            found.append(Flip(**what))
    return tuple(sorted(found, key=lambda f: (f.won, f.scenario_type, f.scenario_id)))
