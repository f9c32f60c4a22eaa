"""From episode records to the figures of a report: per type, group, overall.

Source: docs/metrics.md, "Aggregation".
Two readings always go together: *strict* (error outcomes count as failures, every asked scenario is in the
denominator) and *completed* (episodes without an error outcome). Nothing is averaged over a hole: a pair with
a missing half is in no figure of pairs.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
import pyarrow as pa

from tsbench.core.errors import InputError
from tsbench.episode.outcome import Outcome
from tsbench.geometry.polyline import Array
from tsbench.metrics.breakdown import Mask, Scores, StrictAndCompleted, break_down
from tsbench.metrics.episode_metrics import METRICS
from tsbench.metrics.intervals import LEVEL, ClusterBootstrap, Estimate, sums_by_cluster
from tsbench.metrics.metric import Metric
from tsbench.metrics.records import Records, split_records
from tsbench.scenarios.data_set import DataSet

SUMMARY_SCHEMA = 4
# Of a driver that reads no plate and is there to show how far that leads.
FLOOR = "floor"


@dataclass(frozen=True)
class PlannerSummary:
    """Everything about one planner, the figures as in `Breakdown`. Shares are in %.

    mark: what stands behind its name, FLOOR or where it is from ("third-party"), "" for none. placed: places are known,
    otherwise each map counts as one. outcomes: episodes by outcome.
    """

    planner: str
    mark: str
    asked: int
    recorded: int
    completed: int
    placed: bool
    outcomes: Mapping[str, int]
    scores: Mapping[str, Scores[Estimate]]
    metrics: Mapping[str, StrictAndCompleted[Estimate]]

    @property
    def label(self) -> str:
        return label(self.planner, self.mark)

    @property
    def floor(self) -> bool:
        return self.mark == FLOOR

    @property
    def primary(self) -> Scores[Estimate]:
        """Paired SCD; of records without pairs the first figure of SCD that they have."""
        return next(iter(self.scores.values()))

    @property
    def kinds(self) -> frozenset[str]:
        """The types that any figure of SCD is over."""
        return frozenset(kind for scores in self.scores.values() for kind in scores.types)


def label(planner: str, mark: str) -> str:
    """A planner's name as tables show it."""
    return f"{planner} ({mark})" if mark else planner


@dataclass(frozen=True)
class Summary:
    """A whole report in numbers. edition: the contract's name, "" where it has none."""

    title: str
    contract_hash: str
    edition: str
    partial: bool
    level: float
    resamples: int
    types_in_benchmark: int
    units: Mapping[str, str]
    planners: tuple[PlannerSummary, ...]

    def to_json(self) -> str:
        content = {"schema": SUMMARY_SCHEMA, **asdict(self)}
        return json.dumps(content, ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def summarise(
    episodes: pa.Table,
    *,
    contract_hash: str,
    asked: Mapping[str, int],
    edition: str = "",
    marks: Mapping[str, str] | None = None,
    allow_partial: bool = False,
) -> Summary:
    """Aggregate the records of a run.

    asked: scenarios asked of each planner. edition: as in `Summary`. marks: by planner, as in `PlannerSummary`. Raises
    InputError for holes (asked without a record) unless partial figures are allowed, for records never asked for, and
    for malformed ones.
    """
    records = split_records(episodes)
    holes = _holes(records, asked)
    name_holes(holes, asked, allow_partial)
    bootstrap = ClusterBootstrap(contract_hash)
    planners = tuple(
        _planner(name, (marks or {}).get(name, ""), records[name], n, bootstrap)
        for name, n in sorted(asked.items())
        if name in records
    )
    units = {name: metric.unit for name, metric in METRICS.items()}
    catalog, driven = DataSet().catalog, {kind for p in planners for kind in p.kinds}
    several = any(kind.id in driven for kind in catalog.combined)
    types = len(catalog.combined if several else catalog.types)
    title = f"{len(driven)} of {types} types, {sum(asked.values())} episodes asked"
    title = f"PARTIAL, {sum(holes.values())} episodes missing: {title}" if holes else title
    return Summary(
        title=title, contract_hash=contract_hash, edition=edition, partial=bool(holes),
        level=LEVEL, resamples=bootstrap.resamples, types_in_benchmark=types, units=units, planners=planners,
    )  # fmt: skip


def name_holes(holes: Mapping[str, int], asked: Mapping[str, int], allow_partial: bool) -> str:
    """Holes in words, "" where there are none. Raises InputError for those that are not allowed."""
    named = ", ".join(f"{name}: {k} of {asked[name]}" for name, k in holes.items() if k)
    if named and not allow_partial:
        raise InputError(f"scenarios without a record ({named}): continue the run, or pass --allow-partial")
    return named


def _holes(records: Mapping[str, Records], asked: Mapping[str, int]) -> dict[str, int]:
    unasked = [name for name in records if name not in asked]
    if unasked:
        raise InputError(f"episode records: planner {unasked[0]!r} was not asked for in this run")
    missing = {name: n - (len(records[name]) if name in records else 0) for name, n in sorted(asked.items())}
    for name, k in missing.items():
        if k < 0:
            raise InputError(f"episode records: {name}: {-k} more than the {asked[name]} that were asked")
    return {name: k for name, k in missing.items() if k}


def _planner(name: str, mark: str, records: Records, asked: int, bootstrap: ClusterBootstrap) -> PlannerSummary:
    def measure(
        metric: Metric, label: str, records: Records, values: Sequence[Array], use: Mask, macro: bool
    ) -> Estimate:
        total, count = sums_by_cluster(values[0][use], records.place[use], records.kind[use], len(records.kinds))
        return bootstrap.estimate(label, total, count, metric.scale, metric.binary, macro)

    outcomes = {outcome.value: records.outcomes.count(outcome.value) for outcome in Outcome}
    whole = int(np.count_nonzero(~records.error))
    figures = break_down([records], measure)
    return PlannerSummary(name, mark, asked, len(records), whole, records.placed, outcomes, *figures)
