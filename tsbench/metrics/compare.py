"""Two planners compared over the same pairs and scenarios: what changed by type and group, and what flipped.

Source: docs/spec/metrics.md, "Aggregation". As everywhere, strict and completed figures go together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from tsbench.core.errors import InputError
from tsbench.geometry.polyline import Array
from tsbench.metrics.breakdown import Mask, Scores, StrictAndCompleted, break_down
from tsbench.metrics.episode import SCD, Metric
from tsbench.metrics.intervals import ClusterBootstrap
from tsbench.metrics.paired import Difference, Pairs, adjust, difference
from tsbench.metrics.records import Records, split_records

_SAME = ("scenario_id", "scenario_type", "group", "map_id", "pair_id", "half")
_SHOWN = {"outcome": "outcome", "clause": "violation_clause", "error": "error"}


@dataclass(frozen=True, slots=True)
class Flip:
    """A scenario that one of the two has as SCD and the other has not. won: it is B that has it.

    clause_*: first clause of the target rule that was broken; error_*: cause of an error outcome; None if none.
    """

    scenario_id: str
    scenario_type: str
    group: str
    map_id: str
    pair_id: str
    half: str
    won: bool
    outcome_a: str
    clause_a: str | None
    error_a: str | None
    outcome_b: str
    clause_b: str | None
    error_b: str | None


@dataclass(frozen=True)
class Comparison:
    """B against A, the figures as in `Breakdown`, types after Holm. flips: lost ones first, then by type.

    scenarios: that both drove; completed: those without an error outcome on either side.
    """

    scores: Mapping[str, Scores[Difference]]
    metrics: Mapping[str, StrictAndCompleted[Difference]]
    flips: tuple[Flip, ...]
    scenarios: int
    completed: int

    @property
    def primary(self) -> Scores[Difference]:
        """Paired SCD; of records without pairs the first figure of SCD that they have."""
        return next(iter(self.scores.values()))


def shared_scenarios(a: pa.Table, b: pa.Table) -> tuple[pa.Table, pa.Table]:
    """The records of scenarios that both have."""
    return a.filter(pc.is_in(a["scenario_id"], b["scenario_id"])), b.filter(
        pc.is_in(b["scenario_id"], a["scenario_id"])
    )


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
    bootstrap = ClusterBootstrap(seed)

    def measure(
        metric: Metric, label: str, records: Records, values: Sequence[Array], use: Mask, macro: bool
    ) -> Difference:
        x, y = (v[use] for v in values)
        pairs = Pairs(x, y, records.place[use], records.kind[use], len(records.kinds))
        return difference(bootstrap, label, pairs, metric, macro)

    found = break_down([left, right], measure)
    scores = {part: _adjusted(figures) for part, figures in found.scores.items()}
    whole = int(np.count_nonzero(~left.error & ~right.error))
    return Comparison(scores, found.metrics, _flips(a, b), len(left), whole)


def _adjusted(figures: Scores[Difference]) -> Scores[Difference]:
    """Holm over the strict figures of the types, and over the completed ones."""
    strict = adjust({kind: figure.main for kind, figure in figures.types.items()}, SCD.scale)
    completed = adjust({kind: figure.completed for kind, figure in figures.types.items()}, SCD.scale)
    return replace(
        figures, types={kind: StrictAndCompleted(strict[kind], completed[kind]) for kind in figures.types}
    )


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
