"""How sure the SCD of each planner is: overall and by group with its interval, the published figure beside it."""

from __future__ import annotations

from functools import partial

from matplotlib.figure import Figure

from tsbench.metrics.aggregate import Figure as Twice
from tsbench.metrics.aggregate import PlannerSummary
from tsbench.report.analyses.columns import COMPLETED, STRICT, pick, present_groups, readings
from tsbench.report.analyses.model import Analysis, Column, Kind, Row, Table, Value
from tsbench.report.analyses.panels import ALL, colour_of, forest_panels, published_mark, put_title
from tsbench.report.analyses.pool import Pool
from tsbench.report.analyses.published import NOTE, published_scd
from tsbench.report.tables.charts import INK
from tsbench.report.tables.forest import ForestRow, Mark


def intervals(pool: Pool) -> Analysis:
    """One row for each planner, panel (all types, each group) and reading, with what the interval rests on."""
    columns = (
        Column("planner", "planner", Kind.TEXT), Column("group", "types", Kind.TEXT),
        Column("figure", "figure", Kind.TEXT), Column("scd", "SCD\n%"), Column("episodes", "n", Kind.COUNT),
        Column("maps", "maps", Kind.COUNT), Column("types", "types\naveraged", Kind.COUNT),
        Column("published", "published\n%", Kind.NUMBER), Column("method", "interval", Kind.TEXT),
    )  # fmt: skip
    panels = (None, *present_groups(pool.summaries))
    rows = []
    for p in pool.summaries:
        for group in panels:
            for reading in readings(p):
                e = pick(_figure(p, group), reading)
                if e is None:
                    continue
                told = f"{e.method} ({e.reason})" if e.reason else e.method
                first = reading == STRICT
                reference = published_scd(p.planner, group) if first else None
                cells = (
                    p.planner,
                    group or ALL,
                    reading,
                    Value.of(e),
                    e.n,
                    e.clusters,
                    e.parts,
                    reference,
                    told,
                )
                rows.append(Row(cells, starts=first and group is None, faint=not first))
    notes = (
        "SCD: sign-compliant and arrived, %, macro mean over types, with its 95 % interval",
        "strict: error outcomes count as failures; completed: episodes without an error outcome",
        NOTE,
    )
    title = pool.title("SCD with intervals")
    table = Table(columns, tuple(rows), 3)
    return Analysis("intervals", title, pool.contract, table, notes, partial(_draw, pool, title))


def _figure(p: PlannerSummary, group: str | None) -> Twice | None:
    return p.overall if group is None else p.groups.get(group)


def _draw(pool: Pool, title: str) -> Figure:
    panels = {}
    for group in (None, *present_groups(pool.summaries)):
        name = group or ALL
        panels[name] = [_row(p, group, colour_of(name)) for p in pool.summaries]
    key = {
        "SCD, strict, with its 95 % interval": Mark(0.0, 0.0, 0.0, INK),
        "published": published_mark(0.0),
    }
    if any(len(readings(p)) > 1 for p in pool.summaries):
        key["completed only"] = Mark(0.0, None, None, INK, marker="x")
    figure = forest_panels(
        panels, "SCD, % (macro mean over types); right: episodes that it rests on", (0.0, 100.0), key
    )
    put_title(figure, title, pool.contract)
    return figure


def _row(p: PlannerSummary, group: str | None, colour: str) -> ForestRow:
    strict, completed = (pick(_figure(p, group), reading) for reading in (STRICT, COMPLETED))
    marks = [published_mark(published_scd(p.planner, group))]
    if strict is not None and completed is not None:
        cross = None if strict.n == completed.n else completed.value
        marks.append(Mark(strict.value, strict.low, strict.high, colour, width=2.0, cross=cross))
    counts = "" if strict is None or completed is None else f"{strict.n}"
    if strict is not None and completed is not None and completed.n != strict.n:
        counts += f" ({completed.n})"
    return ForestRow(p.planner, tuple(marks), counts)
