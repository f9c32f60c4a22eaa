"""How sure is the SCD of each planner? Overall and by group with its interval, the published figure beside it.

Does a conventional metric say how well planners obey? Spearman's rank correlation with SCD, by group. A point is a
planner; what is ranked is the planner's mean. So n is the number of planners, and the interval is about other planners
of the same kind (Bonett and Wright 2000), not about other scenes. Planners that share their driver are no independent
draws: the interval is the least that is unknown.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from math import atanh, sqrt, tanh

import numpy as np
from matplotlib.figure import Figure

from tsbench.core.errors import InputError
from tsbench.metrics.aggregate import PlannerSummary
from tsbench.metrics.breakdown import COMPLETED, STRICT
from tsbench.metrics.episode_metrics import METRICS
from tsbench.metrics.intervals import LEVEL, MIN_CLUSTERS
from tsbench.metrics.records import Records
from tsbench.metrics.scd import NAMES, SCD_NOTE, SIGNED_ONES
from tsbench.report.analyses.analysis import ALL, Analysis, Column, Kind, Row, Table, Value
from tsbench.report.analyses.columns import (
    NOTE,
    READINGS_NOTE,
    count_columns,
    is_whole,
    number_columns,
    panels_of,
    pick,
    present_panels,
    present_parts,
    published_metric,
    published_scd,
    readings,
    scd_beside,
    text_columns,
    without_experts,
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
    draw = partial(_draw_intervals, pool, title)
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


def _draw_intervals(pool: RunPool, title: str, stacked: bool = False) -> Figure:
    primary = present_parts(pool.summaries)[0]
    panels = {}
    for name in present_panels(pool.summaries):
        panels[name] = [_forest_row(p, primary, name, colour_of(name), pool.contract) for p in pool.summaries]
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


def _forest_row(p: PlannerSummary, part: str, panel: str, colour: str, contract: str) -> ForestRow:
    told = scd_beside(p, panel, contract) if part == SIGNED_ONES else None
    marks, counts = [published_mark(told)], ""
    if (figure := panels_of(p, part).get(panel)) is not None:
        strict, completed = figure.main, figure.completed
        cross = completed.value if figure.differ else None
        sure = strict.low is not None
        marks.append(Mark(strict.value, strict.low, strict.high, colour, sure, width=2.0, cross=cross))
        counts = f"{strict.n} ({completed.n})" if figure.differ else f"{strict.n}"
    return ForestRow(p.label, tuple(marks), counts)


LEAST_PLANNERS, LEAST_FOR_INTERVAL = 3, 5
# What SCD is made of (compliance) or only says whether there was a rule (engagement) is no conventional metric.
_METRICS = tuple(name for name, metric in METRICS.items() if not metric.about_rule)

_TOLD = (
    "the nine: the study's planners without experts; signed SCD, and metrics over the signed episodes of all types. "
    "study: the same, computed from the study's table, which has no metric by group"
)

_Points = Sequence[float | None]


def spearman(x: _Points, y: _Points) -> Value:
    """Spearman's correlation of the points that have both, from SciPy, with its 95 % interval and n.

    Interval: Fisher's z with the standard error sqrt((1 + r^2 / 2) / (n - 3)) of Bonett and Wright (2000, Psychometrika
    65, 23-28). None below five points, and where the ranks agree wholly: Fisher's z has no end there.
    """
    from scipy.stats import norm, spearmanr  # slow to import

    points = [(a, b) for a, b in zip(x, y, strict=True) if a is not None and b is not None]
    n = len(points)
    if n < LEAST_PLANNERS:
        return Value(None, n=n, reason=f"fewer than {LEAST_PLANNERS} planners")
    first, second = (np.array(values) for values in zip(*points, strict=True))
    if np.ptp(first) == 0.0 or np.ptp(second) == 0.0:
        return Value(None, n=n, reason="the same for all planners")
    r = float(spearmanr(first, second).statistic)
    if n < LEAST_FOR_INTERVAL:
        return Value(r, n=n, reason=f"fewer than {LEAST_FOR_INTERVAL} planners: no interval")
    if abs(r) > 1.0 - 1e-9:
        return Value(r, n=n, reason="ranks agree wholly: no interval")
    reach = float(norm.ppf((1 + LEVEL) / 2)) * sqrt((1 + r * r / 2) / (n - 3))
    return Value(r, tanh(atanh(r) - reach), tanh(atanh(r) + reach), n)


def correlations(pool: RunPool) -> Analysis:
    """One row for each panel (all types, each group), metric and reading. Raises InputError below 3 planners."""
    if len(pool.planners) < LEAST_PLANNERS:
        raise InputError(
            f"correlations are over planners: at least {LEAST_PLANNERS} are needed, the runs have {len(pool.planners)}"
        )
    scd = NAMES[present_parts(pool.summaries)[0]]
    columns = (
        Column("group", f"{scd} of", Kind.TEXT),
        *text_columns("metric", "figure"),
        Column("rho", "ρ, metric over\nthe same episodes", decimals=2),
        Column("planners", "planners", Kind.COUNT),
        Column("rho_overall", "ρ, metric over\nall episodes", decimals=2),
        Column("planners_overall", "planners", Kind.COUNT),
        Column("nine", "ρ, signed SCD,\nthe nine here", decimals=2),
        Column("study", "ρ, signed SCD,\nthe nine, study", decimals=2),
    )
    rows = []
    differ = any(pool.records[name].error.any() for name in pool.planners)
    for panel in present_panels(pool.summaries):
        for k, metric in enumerate(_METRICS):
            for reading in (STRICT, COMPLETED) if differ else (STRICT,):
                first = reading == STRICT
                values = (_ours(pool, panel, panel, metric, reading), _ours(pool, panel, ALL, metric, reading))
                cells = [part for value in values for part in (value, value.n)]
                cells += _of_the_nine(pool, panel, metric) if first else (None, None)
                rows.append(Row((panel, metric, reading, *cells), starts=first and not k, faint=not first))
    notes = (
        f"ρ: Spearman's rank correlation, over planners, of a metric (mean over episodes) with {scd} (macro mean over "
        "types); below it its 95 % interval (Bonett and Wright 2000), from 5 planners on",
        "strict: error outcomes count as failures where a metric has a value for that; completed: episodes without one",
        *([_TOLD] if any(row.cells[7] is not None for row in rows) else []),
        *_without(rows),
    )
    title = pool.title(f"Conventional metrics and {scd} over {len(pool.planners)} planners")
    table = Table(columns, tuple(rows), 3)
    draw = partial(_draw_correlations, pool, title)
    return Analysis("correlations", title, pool.contract, table, notes, draw, partial(draw, stacked=True))


def _ours(pool: RunPool, panel: str, over: str, metric: str, reading: str) -> Value:
    """The primary SCD of `panel` against the metric over the episodes of `over`."""
    figures = (panels_of(p, present_parts(pool.summaries)[0]).get(panel) for p in pool.summaries)
    scd = [None if (e := pick(figure, reading)) is None else e.value for figure in figures]
    return spearman([metric_mean(pool.records[name], over, metric, reading) for name in pool.planners], scd)


def metric_mean(records: Records, panel: str, metric: str, reading: str) -> float | None:
    """A metric's mean over a planner's episodes of a panel, as in the summary; None where none counts."""
    column = METRICS[metric]
    values = records.values[column.column]
    if reading == STRICT and column.failure is not None:
        values = np.where(records.error, column.failure, values)
    inside = records.panels().get("" if panel == ALL else panel)
    values = values[inside & ~np.isnan(values)] if inside is not None else values[:0]
    # Rounded, so that noise in the last place breaks no tie.
    return round(column.scale * float(values.mean()), 9) if len(values) else None


def _of_the_nine(pool: RunPool, panel: str, metric: str) -> tuple[Value | None, Value | None]:
    """Signed SCD of a panel against a metric over the study's nine planners: here, and in its table.

    None where one of them did not drive the panel on the test split, and for a metric that the study has not.
    """
    nine = without_experts()
    summaries = {p.planner: p for p in pool.summaries}
    theirs = [published_metric(name, metric) for name in nine]
    if None in theirs or not all(
        name in summaries and is_whole(summaries[name], panel, pool.contract) for name in nine
    ):
        return None, None
    figures = [panels_of(summaries[name], SIGNED_ONES)[panel].main.value for name in nine]
    means = [metric_mean(pool.records[name].of(SIGNED_ONES), ALL, metric, STRICT) for name in nine]
    return spearman(means, figures), spearman(theirs, [published_scd(name, panel) for name in nine])


def _without(rows: Sequence[Row]) -> tuple[str, ...]:
    """Why some have no value or no interval, once for each reason."""
    reasons: dict[str, list[str]] = {}
    for row in rows:
        if isinstance(value := row.cells[3], Value) and value.reason and row.cells[2] == STRICT:
            reasons.setdefault(value.reason, []).append(f"{row.cells[0]} {row.cells[1]}")
    return tuple(f"{reason}: {', '.join(names)}" for reason, names in reasons.items())


def _draw_correlations(pool: RunPool, title: str, stacked: bool = False) -> Figure:
    panels = {}
    for panel in present_panels(pool.summaries):
        rows = []
        for metric in _METRICS:
            ours = _ours(pool, panel, panel, metric, STRICT)
            mark = Mark(ours.value, ours.low, ours.high, colour_of(panel), width=2.0)
            rows.append(ForestRow(metric.replace("_", " "), (mark,), str(ours.n)))
        panels[panel] = rows
    key = {"metric over the same episodes, strict, with its 95 % interval": Mark(0.0, 0.0, 0.0, INK)}
    unit = f"Spearman's ρ with {NAMES[present_parts(pool.summaries)[0]]}, from -1 to 1; n: planners"
    figure = forest_panels(panels, unit, (-1.0, 1.0), key, stacked=stacked)
    if not stacked:
        put_title(figure, title, pool.edition)
    return figure
