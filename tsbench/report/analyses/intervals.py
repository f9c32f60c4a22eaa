"""How sure the SCD of each planner is: overall and by group with its interval, the published figure beside it."""

from __future__ import annotations

from functools import partial

from matplotlib.figure import Figure

from tsbench.metrics.aggregate import PlannerSummary
from tsbench.metrics.breakdown import STRICT, Twice
from tsbench.metrics.intervals import Estimate
from tsbench.report.analyses.columns import present_panels, readings, text_columns
from tsbench.report.analyses.model import ALL, Analysis, Column, Kind, Row, Table, Value
from tsbench.report.analyses.pool import Pool
from tsbench.report.analyses.published import NOTE, published_scd
from tsbench.report.tables.charts import INK
from tsbench.report.tables.forest import ForestRow, Mark, colour_of, forest_panels, published_mark, put_title


def intervals(pool: Pool) -> Analysis:
    columns = (
        Column("planner", "planner", Kind.TEXT), Column("group", "types", Kind.TEXT),
        *text_columns("figure"), Column("scd", "SCD\n%"), Column("episodes", "n", Kind.COUNT),
        Column("maps", "maps", Kind.COUNT), Column("types", "types\naveraged", Kind.COUNT),
        Column("published", "published\n%", Kind.NUMBER), Column("method", "interval", Kind.TEXT),
    )  # fmt: skip
    rows = []
    for p in pool.summaries:
        for panel, figure in _panels(p).items():
            for reading in readings(p):
                e, first = figure.read(reading), reading == STRICT
                told = f"{e.method} ({e.reason})" if e.reason else e.method
                reference = published_scd(p.planner, panel) if first else None
                cells = (p.planner, panel, reading, Value.of(e), e.n, e.clusters, e.parts, reference, told)
                rows.append(Row(cells, starts=first and panel == ALL, faint=not first))
    notes = (
        "SCD: sign-compliant and arrived, %, macro mean over types, with its 95 % interval",
        "strict: error outcomes count as failures; completed: episodes without an error outcome",
        NOTE,
    )
    title = pool.title("SCD with intervals")
    table = Table(columns, tuple(rows), 3)
    return Analysis("intervals", title, pool.contract, table, notes, partial(_draw, pool, title))


def _panels(p: PlannerSummary) -> dict[str, Twice[Estimate]]:
    return {ALL: p.overall, **p.groups}


def _draw(pool: Pool, title: str) -> Figure:
    panels = {}
    for name in present_panels(pool.summaries):
        panels[name] = [_row(p, name, colour_of(name)) for p in pool.summaries]
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


def _row(p: PlannerSummary, panel: str, colour: str) -> ForestRow:
    marks, counts = [published_mark(published_scd(p.planner, panel))], ""
    if (figure := _panels(p).get(panel)) is not None:
        strict, completed = figure.main, figure.completed
        cross = completed.value if figure.differ else None
        marks.append(Mark(strict.value, strict.low, strict.high, colour, width=2.0, cross=cross))
        counts = f"{strict.n} ({completed.n})" if figure.differ else f"{strict.n}"
    return ForestRow(p.planner, tuple(marks), counts)
