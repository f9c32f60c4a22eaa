"""The main table: every planner's SCD and conventional metrics, the published figures below its own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from tsbench.episode.outcome import Outcome
from tsbench.metrics.aggregate import PlannerSummary, Summary
from tsbench.metrics.breakdown import STRICT
from tsbench.metrics.episode_metrics import METRICS
from tsbench.metrics.scd_records import SIGNED_ONES
from tsbench.report.analyses.columns import (
    INTERVAL_NOTE,
    NAMES,
    READINGS_NOTE,
    SCD_NOTE,
    panels_of,
    pick,
    present_panels,
    present_parts,
    readings,
    text_columns,
)
from tsbench.report.analyses.model import ALL, Analysis, Cell, Column, Kind, Row, Table, Value
from tsbench.report.analyses.per_type import per_type
from tsbench.report.analyses.published import NOTE, metric_beside, scd_beside

PUBLISHED = "published"
_METRICS = {name: metric for name, metric in METRICS.items() if metric.head}


def main_table(planners: Sequence[PlannerSummary], title: str, contract: str, beside: str = "") -> Analysis:
    """One row for each reading of each planner: strict, completed where it differs, published.

    beside: the contract, where the study's figures may stand beside those of its planners.
    """
    first, *others = present_parts(planners)
    # The primary figure by group too, the others beside it.
    shown = [*((first, panel) for panel in present_panels(planners)), *((part, ALL) for part in others)]
    columns = (
        *text_columns("planner", "figure"), Column("n", "n", Kind.COUNT),
        *(_column(part, panel) for part, panel in shown),
        *(Column(name, f"{metric.head}\n{metric.unit}") for name, metric in _METRICS.items()),
    )  # fmt: skip
    rows = tuple(row for p in planners for row in _rows(p, shown, beside))
    notes = (
        f"{SCD_NOTE}; other metrics are means over episodes. Below each figure its {INTERVAL_NOTE}",
        f"{READINGS_NOTE}. n: episodes; what fewer or pairs count for has its own n in the CSV",
        *(f"{p.label}: {line}" for p in planners for line in _warnings(p)),
        *([NOTE] if any(row.cells[1] == PUBLISHED for row in rows) else []),
    )
    return Analysis("main", title, contract, Table(columns, rows, 3), notes)


def _column(part: str, panel: str) -> Column:
    key, head = ("overall", "all") if panel == ALL else (panel, panel)
    return Column(f"{part}_{key}", f"{NAMES[part]}\n{head}")


def _warnings(p: PlannerSummary) -> Iterator[str]:
    bad = {kind: n for kind, n in p.outcomes.items() if n and Outcome(kind).is_error}
    if bad:
        named = ", ".join(f"{n} {kind}" for kind, n in bad.items())
        yield f"{p.recorded - p.completed} error outcomes ({named}), causes in errors/"
    fewer = {name: n for name in _METRICS if (n := p.metrics[name].completed.n) < p.completed}
    if fewer:
        named = ", ".join(f"{name} {n}" for name, n in fewer.items())
        yield f"of {p.completed} completed episodes these metrics apply to fewer: {named}"
    for part, scores in p.scores.items():
        if scores.overall.main.value is not None and scores.overall.main.low is None:
            yield f"no interval for the overall {NAMES[part]}: {scores.overall.main.reason}"


def _rows(p: PlannerSummary, shown: Sequence[tuple[str, str]], beside: str) -> Iterator[Row]:
    for reading in readings(p):
        figures = [pick(panels_of(p, part).get(panel), reading) for part, panel in shown]
        figures += [pick(p.metrics[name], reading) for name in _METRICS]
        cells: list[Cell] = [Value.of(figure) for figure in figures]
        first = reading == STRICT
        n = p.recorded if first else p.completed
        yield Row((p.label, reading, n, *cells), starts=first, faint=not first)
    # What the reference published is over signed scenes.
    told = [scd_beside(p, panel, beside) if part == SIGNED_ONES else None for part, panel in shown]
    told += [metric_beside(p, name, beside) for name in _METRICS]
    if any(number is not None for number in told):
        cells = [None if number is None else Value(number) for number in told]
        yield Row((p.label, PUBLISHED, None, *cells), faint=True)


def run_tables(summary: Summary) -> tuple[Analysis, ...]:
    return (
        main_table(summary.planners, summary.title, summary.contract_hash),
        per_type(summary.planners, f"{summary.title}: SCD by type", summary.contract_hash),
    )
