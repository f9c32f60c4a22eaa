"""How sure the SCD of each planner is: overall and by group with its interval, the published figure beside it."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from matplotlib.figure import Figure

from tsbench.metrics.aggregate import PlannerSummary
from tsbench.metrics.breakdown import STRICT
from tsbench.metrics.intervals import MIN_CLUSTERS
from tsbench.metrics.scd import NAMES, SCD_NOTE, SIGNED_ONES
from tsbench.report.analyses.analysis import ALL, Analysis, Column, Row, Table, Value
from tsbench.report.analyses.columns import (
    NOTE,
    READINGS_NOTE,
    count_columns,
    number_columns,
    panels_of,
    present_panels,
    present_parts,
    readings,
    scd_beside,
    text_columns,
)
from tsbench.report.analyses.run_pool import RunPool
from tsbench.report.charts import INK
from tsbench.report.forest import ForestRow, Mark, colour_of, forest_panels, published_mark, put_title


def intervals(pool: RunPool) -> Analysis:
    columns = (
        *text_columns("planner", group="types"),
        *text_columns("score", "figure"),
        Column("scd", "SCD\n%"),
        *count_columns("n", "places", types="types\naveraged"),
        *number_columns(published="published\n%"),
        *text_columns(method="interval"),
    )
    table = Table(columns, tuple(row for p in pool.summaries for row in _rows(p, pool.contract)), 4)
    told = [NOTE] if any(row.cells[8] is not None for row in table.rows) else []
    notes = (f"{SCD_NOTE}, with its 95 % interval. n: pairs, halves", READINGS_NOTE, *told)
    title = pool.title("SCD with intervals")
    draw = partial(_draw, pool, title)
    return Analysis("intervals", title, pool.contract, table, notes, draw, partial(draw, stacked=True))


def _rows(p: PlannerSummary, contract: str) -> Iterator[Row]:
    starts = True
    for part, scores in p.scores.items():
        for panel, figure in scores.panels(ALL).items():
            for reading in readings(p):
                e, first = figure.read(reading), reading == STRICT
                told = f"{e.method} ({e.reason})" if e.reason else e.method
                reference = scd_beside(p, panel, contract) if first and part == SIGNED_ONES else None
                names = (p.label, panel, NAMES[part], reading)
                cells = (*names, Value.of(e), e.n, e.clusters, e.parts, reference, told)
                yield Row(cells, starts=starts, faint=not first)
                starts = False


def _draw(pool: RunPool, title: str, stacked: bool = False) -> Figure:
    primary = present_parts(pool.summaries)[0]
    panels = {}
    for name in present_panels(pool.summaries):
        panels[name] = [_row(p, primary, name, colour_of(name), pool.contract) for p in pool.summaries]
    key = {f"{NAMES[primary]}, strict, with its 95 % interval": Mark(0.0, 0.0, 0.0, INK)}
    if any(m.value is not None and m.low is None for rows in panels.values() for r in rows for m in r.marks[1:]):
        key[f"no interval: fewer than {MIN_CLUSTERS} places"] = Mark(0.0, None, None, INK, filled=False)
    if any(row.marks[0].value is not None for rows in panels.values() for row in rows):
        key["published"] = published_mark(0.0)
    if any(len(readings(p)) > 1 for p in pool.summaries):
        key["completed only"] = Mark(0.0, None, None, INK, marker="x")
    unit = f"{NAMES[primary]}, % (macro mean over types); n: what it rests on"
    figure = forest_panels(panels, unit, (0.0, 100.0), key, stacked=stacked)
    if not stacked:
        put_title(figure, title, pool.edition)
    return figure


def _row(p: PlannerSummary, part: str, panel: str, colour: str, contract: str) -> ForestRow:
    told = scd_beside(p, panel, contract) if part == SIGNED_ONES else None
    marks, counts = [published_mark(told)], ""
    if (figure := panels_of(p, part).get(panel)) is not None:
        strict, completed = figure.main, figure.completed
        cross = completed.value if figure.differ else None
        sure = strict.low is not None
        marks.append(Mark(strict.value, strict.low, strict.high, colour, sure, width=2.0, cross=cross))
        counts = f"{strict.n} ({completed.n})" if figure.differ else f"{strict.n}"
    return ForestRow(p.label, tuple(marks), counts)
