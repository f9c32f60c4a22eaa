"""From episode records to the figures of a report: per type, group, overall.

Source: docs/spec/metrics.md, "Aggregation".
Two figures always go together: *strict* (error outcomes count as failures, every asked scenario is in the
denominator) and *completed* (episodes without an error outcome). Nothing is averaged over a hole.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from tsbench.core.errors import InputError
from tsbench.episode.outcome import Outcome
from tsbench.geometry.polyline import Array
from tsbench.metrics.intervals import LEVEL, ClusterBootstrap, Estimate, sums_by_cluster
from tsbench.metrics.records import METRICS, SCD, MetricColumn, Records, split_records

SUMMARY_SCHEMA = 2
TYPES_IN_BENCHMARK = 29

_Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Figure:
    """One number twice. strict: None for metrics that have no value for a failure."""

    strict: Estimate | None
    completed: Estimate


@dataclass(frozen=True)
class PlannerSummary:
    """Everything about one planner. Shares are in %.

    overall: SCD, macro mean over the types present; groups, types: SCD of each; type_groups: the group of
    each type. metrics: conventional metrics, episode-weighted. outcomes: episodes by outcome.
    """

    planner: str
    asked: int
    recorded: int
    completed: int
    outcomes: Mapping[str, int]
    overall: Figure
    groups: Mapping[str, Figure]
    types: Mapping[str, Figure]
    type_groups: Mapping[str, str]
    metrics: Mapping[str, Figure]


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
        """The same summary gives the same text."""
        content = {"schema": SUMMARY_SCHEMA, **asdict(self)}
        return json.dumps(content, ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def summarise(
    episodes: pa.Table,
    *,
    contract_hash: str,
    asked: Mapping[str, int],
    edition: str = "",
    allow_partial: bool = False,
) -> Summary:
    """Aggregate the records of a run.

    asked: scenarios asked of each planner. edition: as in `Summary`. Raises InputError for holes (asked without a
    record) unless partial figures are allowed, for records never asked for, and for malformed ones.
    """
    records = split_records(episodes)
    holes = _holes(records, asked)
    if holes and not allow_partial:
        named = ", ".join(f"{planner}: {k} of {asked[planner]}" for planner, k in holes.items())
        raise InputError(f"scenarios without a record ({named}): continue the run, or pass --allow-partial")
    bootstrap = ClusterBootstrap(contract_hash)
    planners = tuple(
        _planner(name, records[name], n, bootstrap) for name, n in sorted(asked.items()) if name in records
    )
    return Summary(
        title=_title(planners, asked, holes),
        contract_hash=contract_hash,
        edition=edition,
        partial=bool(holes),
        level=LEVEL,
        resamples=bootstrap.resamples,
        types_in_benchmark=TYPES_IN_BENCHMARK,
        units={name: metric.unit for name, metric in METRICS.items()},
        planners=planners,
    )


def _holes(records: Mapping[str, Records], asked: Mapping[str, int]) -> dict[str, int]:
    unasked = [name for name in records if name not in asked]
    if unasked:
        raise InputError(f"episode records: planner {unasked[0]!r} was not asked for in this run")
    missing = {name: n - (len(records[name]) if name in records else 0) for name, n in sorted(asked.items())}
    for name, k in missing.items():
        if k < 0:
            raise InputError(f"episode records: {name}: {-k} more than the {asked[name]} that were asked")
    return {name: k for name, k in missing.items() if k}


def _title(planners: tuple[PlannerSummary, ...], asked: Mapping[str, int], holes: Mapping[str, int]) -> str:
    types = len({kind for p in planners for kind in p.types})
    text = f"{types} of {TYPES_IN_BENCHMARK} types, {sum(asked.values())} episodes asked"
    return f"PARTIAL, {sum(holes.values())} episodes missing: {text}" if holes else text


def _planner(name: str, records: Records, asked: int, bootstrap: ClusterBootstrap) -> PlannerSummary:
    group_of = records.type_groups()
    everyone = np.ones(len(records), dtype=bool)
    groups, types = {}, {}
    for group in dict.fromkeys(group_of.values()):
        inside = np.array([g == group for g in records.groups])
        groups[group] = _figure(bootstrap, f"group {group}", records, SCD, inside[records.kind], macro=True)
    for kind in group_of:
        use = records.kind == records.kinds.index(kind)
        types[kind] = _figure(bootstrap, f"type {kind}", records, SCD, use)
    return PlannerSummary(
        planner=name,
        asked=asked,
        recorded=len(records),
        completed=int(np.count_nonzero(~records.error)),
        outcomes={outcome.value: records.outcomes.count(outcome.value) for outcome in Outcome},
        overall=_figure(bootstrap, "overall", records, SCD, everyone, macro=True),
        groups=groups,
        types=types,
        type_groups=group_of,
        metrics={m: _figure(bootstrap, "overall", records, col, everyone) for m, col in METRICS.items()},
    )


def _figure(
    bootstrap: ClusterBootstrap,
    label: str,
    records: Records,
    metric: MetricColumn,
    use: _Mask,
    macro: bool = False,
) -> Figure:
    """One metric over a selection; macro: mean over types, else over episodes."""
    values = records.values[metric.column]

    def estimate(values: Array, use: _Mask) -> Estimate:
        total, count = _sums(records, values, use, macro)
        return bootstrap.estimate(label, total, count, metric.scale, metric.binary)

    completed = estimate(values, use & ~records.error & ~np.isnan(values))
    if metric.failure is None:
        return Figure(None, completed)
    if not (use & records.error).any():
        return Figure(completed, completed)
    return Figure(estimate(np.where(records.error, metric.failure, values), use), completed)


def _sums(records: Records, values: Array, use: _Mask, macro: bool) -> tuple[Array, Array]:
    """(maps, types) sum of values and number of episodes; one column where types are not kept apart."""
    if macro:
        return sums_by_cluster(values[use], records.map_code[use], records.kind[use], len(records.kinds))
    return sums_by_cluster(values[use], records.map_code[use], 0, 1)
