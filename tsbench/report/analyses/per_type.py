"""SCD of every planner on every type, and the same as a heat map."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from tsbench.metrics.aggregate import PlannerSummary
from tsbench.metrics.breakdown import COMPLETED, STRICT, Twice
from tsbench.metrics.intervals import Estimate
from tsbench.report.analyses.columns import pick, present_types, text_columns
from tsbench.report.analyses.model import Analysis, Cell, Column, Kind, Row, Table, Value
from tsbench.report.analyses.shown import DASH

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HALF = 50.0


def per_type(planners: Sequence[PlannerSummary], title: str, contract: str) -> Analysis:
    """One row for each type; a second one, completed only, where some planner has error outcomes there."""
    rows: list[Row] = []
    last = ""
    for kind, group in present_types(planners):
        figures = [p.types.get(kind) for p in planners]
        differ = any(figure and figure.differ for figure in figures)
        for reading in (STRICT, COMPLETED) if differ else (STRICT,):
            cells: list[Cell] = []
            for figure in figures:
                estimate = pick(figure, reading)
                cells += [Value.of(estimate), None if estimate is None else estimate.n]
            first = reading == STRICT
            cells = [group, kind, reading, *cells, _maps(figures, reading)]
            rows.append(Row(tuple(cells), starts=first and group != last, faint=not first))
            last = group
    columns = [*text_columns("group", "type", "figure")]
    for name in (p.planner for p in planners):
        columns += [Column(name, f"{name}\n%"), Column(f"{name}_episodes", "n", Kind.COUNT)]
    columns.append(Column("maps", "maps", Kind.TEXT))
    notes = (
        "SCD: sign-compliant and arrived, % of n episodes. Below each figure its 95 % interval (cluster bootstrap over "
        "maps; Wilson where maps do not differ)",
        "strict: error outcomes count as failures; completed, where it differs: episodes without an error outcome",
    )
    table = Table(tuple(columns), tuple(rows), 3, 12)
    return Analysis("types", title, contract, table, notes, partial(_draw, planners, title, contract))


def _maps(figures: Sequence[Twice[Estimate] | None], reading: str) -> str:
    """How many maps a row rests on; where planners of a partial run differ, from least to most."""
    counts = [e.clusters for figure in figures if (e := pick(figure, reading)) is not None]
    return DASH.join(str(n) for n in dict.fromkeys((min(counts), max(counts))))


def _draw(planners: Sequence[PlannerSummary], title: str, contract: str) -> Figure:
    from matplotlib.figure import Figure  # a run ends with this table, and needs no picture of it

    from tsbench.report.tables.forest import put_counts, put_title

    kinds = present_types(planners)
    figure = Figure(
        figsize=(3.6 + 0.62 * max(len(planners), 6), 1.9 + 0.27 * len(kinds)), layout="constrained"
    )
    axes = figure.subplots()
    found = {
        (y, x): e.value
        for y, (kind, _) in enumerate(kinds)
        for x, p in enumerate(planners)
        if (e := pick(p.types.get(kind), STRICT)) is not None and e.value is not None
    }
    shade = [[found.get((y, x), float("nan")) for x in range(len(planners))] for y in range(len(kinds))]
    image = axes.imshow(shade, cmap="cividis", vmin=0.0, vmax=100.0, aspect="auto")
    for (y, x), value in found.items():
        colour = "black" if value > _HALF else "white"
        axes.text(x, y, f"{value:.0f}", ha="center", va="center", fontsize=7, color=colour)
    axes.set_xticks(range(len(planners)), [p.planner for p in planners], rotation=45, ha="right")
    counts = [sorted({e.n for p in planners if (e := pick(p.types.get(kind), STRICT))}) for kind, _ in kinds]
    axes.set_yticks(range(len(kinds)), [f"{kind} ({group})" for kind, group in kinds])
    for label in (*axes.get_xticklabels(), *axes.get_yticklabels()):
        label.set(fontsize=8, parse_math=False)
    put_counts(axes, [f"n {DASH.join(str(n) for n in dict.fromkeys((c[0], c[-1])))}" for c in counts])
    axes.tick_params(length=0)
    bar = figure.colorbar(image, ax=axes, pad=0.02, aspect=40)
    bar.set_label("SCD, % of n episodes for each planner (strict)", fontsize=8)
    bar.ax.tick_params(labelsize=8)
    put_title(figure, title, contract)
    return figure
