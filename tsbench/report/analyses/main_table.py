"""The main table: every planner's SCD and conventional metrics, the published figures below its own."""

from __future__ import annotations

from collections.abc import Iterator

from tsbench.metrics.aggregate import PlannerSummary
from tsbench.report.analyses.columns import pick, present_groups, readings
from tsbench.report.analyses.model import Analysis, Cell, Column, Kind, Row, Table, Value
from tsbench.report.analyses.pool import Pool
from tsbench.report.analyses.published import NOTE, published, published_metric, published_scd

_METRICS = {
    "driving_score": "DS\n%",
    "destination": "dest.\n%",
    "efficiency": "effic.\n%",
    "collision": "coll.\n%",
    "off_road": "off road\n%",
    "comfort": "comf.\n%",
    "engaged": "engag.\n%",
}


def main_table(pool: Pool) -> Analysis:
    """One row for each reading of each planner: strict, completed where it differs, published."""
    groups = present_groups(pool)
    scd = [Column("scd_overall", "SCD\nall"), *(Column(f"scd_{g}", f"SCD\n{g}") for g in groups)]
    columns = (
        Column("planner", "planner", Kind.TEXT), Column("figure", "figure", Kind.TEXT), Column("n", "n", Kind.COUNT),
        *scd, *(Column(name, head) for name, head in _METRICS.items()),
    )  # fmt: skip
    rows = tuple(row for p in pool.summaries for row in _rows(p, groups))
    notes = (
        "SCD: sign-compliant and arrived, %, macro mean over types; other metrics are means over episodes. Below each "
        "figure its 95 % interval (cluster bootstrap over maps; Wilson where maps do not differ)",
        "strict: error outcomes count as failures; completed: episodes without an error outcome. n: episodes; metrics "
        "that apply to fewer have their own n in the CSV",
        NOTE,
    )
    return Analysis("main", pool.title("Main table"), pool.contract, Table(columns, rows, 3), notes)


def _rows(p: PlannerSummary, groups: tuple[str, ...]) -> Iterator[Row]:
    for reading in readings(p):
        figures = [pick(p.overall, reading), *(pick(p.groups.get(g), reading) for g in groups)]
        figures += [pick(p.metrics[name], reading) for name in _METRICS]
        cells: list[Cell] = [Value.of(figure) for figure in figures]
        n = p.recorded if reading == "strict" else p.completed
        first = reading == "strict"
        yield Row((p.planner, reading, n, *cells), starts=first, faint=not first)
    if p.planner in published():
        told = [published_scd(p.planner, None), *(published_scd(p.planner, g) for g in groups)]
        told += [published_metric(p.planner, name) for name in _METRICS]
        cells = [None if number is None else Value(number) for number in told]
        yield Row((p.planner, "published", None, *cells), faint=True)
