"""SCD of every planner on every type, and the same as a heat map."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from tsbench.metrics.aggregate import PlannerSummary
from tsbench.metrics.breakdown import COMPLETED, STRICT, StrictAndCompleted
from tsbench.metrics.intervals import Estimate
from tsbench.report.analyses.columns import (
    INTERVAL_NOTE,
    NAMES,
    READINGS_NOTE,
    SCD_NOTE,
    pick,
    present_parts,
    present_types,
    text_columns,
    with_rings,
)
from tsbench.report.analyses.model import Analysis, Cell, Column, Kind, Row, Table, Value
from tsbench.report.analyses.shown import DASH

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HALF = 50.0


def per_type(planners: Sequence[PlannerSummary], title: str, contract: str) -> Analysis:
    """Rows for each type: a figure of SCD in each, and once more completed only, where errors make a difference."""
    rows: list[Row] = []
    parts, last = present_parts(planners), ""
    for kind, group in present_types(planners):
        # Where there are several figures each type is a block, otherwise each group is.
        block = kind if len(parts) > 1 else group
        for part in parts:
            figures = [_figure(p, part, kind) for p in planners]
            if not any(figures):
                continue
            differ = any(figure and figure.differ for figure in figures)
            for reading in (STRICT, COMPLETED) if differ else (STRICT,):
                starts, last = block != last, block
                cells = _cells(planners, figures, kind, reading)
                rows.append(
                    Row((group, kind, NAMES[part], reading, *cells), starts=starts, faint=reading != STRICT)
                )
    columns = [*text_columns("group", "type", "score", "figure")]
    for p in planners:
        columns += [Column(p.planner, f"{p.label}\n%"), Column(f"{p.planner}_count", "n", Kind.COUNT)]
    columns.append(Column("places", "places", Kind.TEXT))
    notes = (
        f"{SCD_NOTE}. n: pairs, halves. Below each figure its {INTERVAL_NOTE}",
        f"{READINGS_NOTE}, where that differs",
    )
    table = Table(tuple(columns), tuple(rows), 4, 12)
    return Analysis("types", title, contract, table, notes, partial(_draw, planners, title, contract))


def _figure(p: PlannerSummary, part: str, kind: str) -> StrictAndCompleted[Estimate] | None:
    return p.scores[part].types.get(kind) if part in p.scores else None


def _cells(
    planners: Sequence[PlannerSummary],
    figures: Sequence[StrictAndCompleted[Estimate] | None],
    kind: str,
    reading: str,
) -> list[Cell]:
    """Each planner's figure with its n, and how many places they rest on (of partial runs from least to most)."""
    estimates = [pick(figure, reading) for figure in figures]
    cells = [cell for e in estimates for cell in (Value.of(e), None if e is None else e.n)]
    counts = [e.clusters for e in estimates if e is not None]
    placed = all(p.placed for p in planners)
    told = DASH.join(str(n) for n in dict.fromkeys((min(counts), max(counts))))
    return [*cells, with_rings(told, kind, placed)]


def _draw(planners: Sequence[PlannerSummary], title: str, contract: str) -> Figure:
    from matplotlib.figure import Figure  # a run ends with this table, and needs no picture of it

    from tsbench.report.tables.forest import put_counts, put_title

    primary = present_parts(planners)[0]
    kinds = present_types(planners, primary)
    figure = Figure(
        figsize=(3.6 + 0.62 * max(len(planners), 6), 1.9 + 0.27 * len(kinds)), layout="constrained"
    )
    axes = figure.subplots()
    found = {
        (y, x): e.value
        for y, (kind, _) in enumerate(kinds)
        for x, p in enumerate(planners)
        if (e := pick(_figure(p, primary, kind), STRICT)) is not None and e.value is not None
    }
    shade = [[found.get((y, x), float("nan")) for x in range(len(planners))] for y in range(len(kinds))]
    image = axes.imshow(shade, cmap="cividis", vmin=0.0, vmax=100.0, aspect="auto")
    for (y, x), value in found.items():
        colour = "black" if value > _HALF else "white"
        axes.text(x, y, f"{value:.0f}", ha="center", va="center", fontsize=7, color=colour)
    axes.set_xticks(range(len(planners)), [p.label for p in planners], rotation=45, ha="right")
    counts = [
        sorted({e.n for p in planners if (e := pick(_figure(p, primary, kind), STRICT))}) for kind, _ in kinds
    ]
    axes.set_yticks(range(len(kinds)), [f"{kind} ({group})" for kind, group in kinds])
    for label in (*axes.get_xticklabels(), *axes.get_yticklabels()):
        label.set(fontsize=8, parse_math=False)
    put_counts(axes, [f"n {DASH.join(str(n) for n in dict.fromkeys((c[0], c[-1])))}" for c in counts])
    axes.tick_params(length=0)
    bar = figure.colorbar(image, ax=axes, pad=0.02, aspect=40)
    bar.set_label(f"{NAMES[primary]}, % of n for each planner (strict)", fontsize=8)
    bar.ax.tick_params(labelsize=8)
    put_title(figure, title, contract)
    return figure
