"""The main table: every planner's SCD and conventional metrics, the published figures below its own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from tsbench.episode.outcome import Outcome
from tsbench.metrics.aggregate import PlannerSummary, Summary
from tsbench.metrics.breakdown import STRICT
from tsbench.metrics.episode import METRICS
from tsbench.report.analyses.columns import pick, present_panels, readings, text_columns
from tsbench.report.analyses.model import ALL, Analysis, Cell, Column, Kind, Row, Table, Value
from tsbench.report.analyses.per_type import per_type
from tsbench.report.analyses.published import NOTE, published, published_metric, published_scd

_METRICS = {name: metric for name, metric in METRICS.items() if metric.head}


def main_table(planners: Sequence[PlannerSummary], title: str, contract: str) -> Analysis:
    """One row for each reading of each planner: strict, completed where it differs, published."""
    _, *groups = present_panels(planners)
    scd = [Column("scd_overall", "SCD\nall"), *(Column(f"scd_{g}", f"SCD\n{g}") for g in groups)]
    columns = (
        *text_columns("planner", "figure"), Column("n", "n", Kind.COUNT), *scd,
        *(Column(name, f"{metric.head}\n{metric.unit}") for name, metric in _METRICS.items()),
    )  # fmt: skip
    rows = tuple(row for p in planners for row in _rows(p, groups))
    notes = (
        "SCD: sign-compliant and arrived, %, macro mean over types; other metrics are means over episodes. Below each "
        "figure its 95 % interval (cluster bootstrap over maps; Wilson where maps do not differ)",
        "strict: error outcomes count as failures; completed: episodes without an error outcome. n: episodes; metrics "
        "that apply to fewer have their own n in the CSV",
        *(f"{p.planner}: {line}" for p in planners for line in _warnings(p)),
        *([NOTE] if any(p.planner in published() for p in planners) else []),
    )
    return Analysis("main", title, contract, Table(columns, rows, 3), notes)


def _warnings(p: PlannerSummary) -> Iterator[str]:
    bad = {kind: n for kind, n in p.outcomes.items() if n and Outcome(kind).is_error}
    if bad:
        named = ", ".join(f"{n} {kind}" for kind, n in bad.items())
        yield f"{p.recorded - p.completed} error outcomes ({named}), causes in errors/"
    fewer = {name: n for name in _METRICS if (n := p.metrics[name].completed.n) < p.completed}
    if fewer:
        named = ", ".join(f"{name} {n}" for name, n in fewer.items())
        yield f"of {p.completed} completed episodes these metrics apply to fewer: {named}"
    if p.overall.main.value is not None and p.overall.main.low is None:
        yield f"no interval for the overall SCD: {p.overall.main.reason}"


def _rows(p: PlannerSummary, groups: Sequence[str]) -> Iterator[Row]:
    for reading in readings(p):
        figures = [pick(p.overall, reading), *(pick(p.groups.get(g), reading) for g in groups)]
        figures += [pick(p.metrics[name], reading) for name in _METRICS]
        cells: list[Cell] = [Value.of(figure) for figure in figures]
        first = reading == STRICT
        n = p.recorded if first else p.completed
        yield Row((p.planner, reading, n, *cells), starts=first, faint=not first)
    if p.planner in published():
        told = [published_scd(p.planner, panel) for panel in (ALL, *groups)]
        told += [published_metric(p.planner, name) for name in _METRICS]
        cells = [None if number is None else Value(number) for number in told]
        yield Row((p.planner, "published", None, *cells), faint=True)


def run_tables(summary: Summary) -> tuple[Analysis, ...]:
    return (
        main_table(summary.planners, summary.title, summary.contract_hash),
        per_type(summary.planners, f"{summary.title}: SCD by type", summary.contract_hash),
    )
