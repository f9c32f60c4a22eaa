"""Forest plots: values with their intervals, one row each; of a comparison, and as panels side by side."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap
from typing import Any

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tsbench.metrics.breakdown import StrictAndCompleted
from tsbench.metrics.paired_differences import Difference
from tsbench.metrics.scd import NAMES
from tsbench.report.charts import GREY, GROUP_COLOURS, INK, PALE, save_chart
from tsbench.report.compare_runs import Matched

ROW_IN = 0.24
_MARGIN_IN, _WIDTH_IN = 1.9, 9.0


@dataclass(frozen=True, slots=True)
class Mark:
    """A value in a row, in the unit of the axis; None: nothing is drawn.

    low, high: its interval. bracket: grey, this far to both sides of 0 (an effect that would have been found). cross: a
    second value of the same figure (completed only).
    """

    value: float | None
    low: float | None
    high: float | None
    colour: str
    filled: bool = True
    marker: str = "o"
    width: float = 1.4
    bracket: float | None = None
    cross: float | None = None


@dataclass(frozen=True, slots=True)
class ForestRow:
    """A row. count: what it rests on, right of the axes. bold: a mean of others."""

    label: str
    marks: tuple[Mark, ...]
    count: str
    bold: bool = False


def draw_rows(axes: Any, rows: Sequence[ForestRow], labels: bool = True, head: str = "") -> None:
    """Rows from top to bottom. labels: write the rows' names at the left. head: above the counts."""
    for y, row in enumerate(rows):
        for mark in row.marks:
            _draw_mark(axes, y, mark)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_yticks(range(len(rows)), [row.label if row.bold else f"{row.label}  " for row in rows])
    for label, row in zip(axes.get_yticklabels(), rows, strict=True):
        label.set(fontweight="bold" if row.bold else "normal", fontsize=8, parse_math=False)
    axes.tick_params(axis="y", labelleft=labels)
    put_counts(axes, [row.count for row in rows], head)
    axes.grid(axis="x", color="#e4e4e4", linewidth=0.6)
    axes.set_axisbelow(True)


def put_counts(axes: Any, texts: Sequence[str], head: str = "", size: int = 7) -> None:
    """What each row rests on, at the right of its axes; head: what that is, above them."""
    right = axes.secondary_yaxis("right")
    right.set_yticks(range(len(texts)), texts)
    right.tick_params(length=0, labelsize=size)
    right.spines["right"].set_visible(False)
    if head:
        frames = {"xycoords": "axes fraction", "textcoords": "offset points"}
        axes.annotate(head, (1.0, 1.0), (4, 3), **frames, fontsize=size, color=GREY)


def draw_forest(matched: Matched, path: Path) -> None:
    """Write the PNG. Full marks are significant; grey brackets show what the others would have found (MDE)."""
    save_chart(lambda: _forest(matched), path)


def difference_mark(figure: StrictAndCompleted[Difference], colour: str, mean: bool) -> Mark:
    """How a paired difference is drawn: full where it is significant, with its bracket where it is not."""
    d = figure.main
    marker, width = ("D", 2.2) if mean else ("o", 1.4)
    cross = figure.completed.value if figure.differ else None
    return Mark(d.value, d.low, d.high, colour, d.significant, marker=marker, width=width, bracket=d.mde, cross=cross)


def lost_won(figure: StrictAndCompleted[Difference]) -> str:
    """Pairs that only A, only B has, of how many; completed pairs in brackets where there are fewer."""
    d = figure.main
    text = f"{d.lost or 0}/{d.won or 0} of {d.n}"
    return text if not figure.differ else f"{text} ({figure.completed.n})"


def _forest(matched: Matched) -> Figure:
    scores = matched.comparison.primary
    named = NAMES[next(iter(matched.comparison.scores))]

    def row(label: str, figure: StrictAndCompleted[Difference], colour: str, mean: bool) -> ForestRow:
        return ForestRow(label, (difference_mark(figure, colour, mean),), lost_won(figure), mean)

    rows = [row("all types", scores.overall, INK, True)]
    for group, figure in scores.groups.items():
        colour = GROUP_COLOURS.get(group, INK)
        rows.append(row(group, figure, colour, True))
        rows += [row(kind, scores.types[kind], colour, False) for kind, g in scores.type_groups.items() if g == group]
    drawing = Figure(figsize=(_WIDTH_IN, _MARGIN_IN + ROW_IN * len(rows)), layout="constrained")
    axes = drawing.subplots()
    draw_rows(axes, rows)
    axes.axvline(0.0, color=GREY, linewidth=0.8)
    axes.set_xlabel(
        f"{named} of B minus that of A, percentage points (strict), 95 % interval over places\n"
        "full: significant (exact McNemar, types after Holm); grey: minimum detectable effect; right: lost/won of n\n"
        "x: completed only, pairs without an error outcome; their n in brackets",
        fontsize=7.5,
    )
    runs = matched.a.run, matched.b.run
    made_of = dict.fromkeys(f"edition {run.edition}, {run.manifest['effective']['split']} split" for run in runs)
    lines = [*matched.warnings, f"A: {matched.a.label}", f"B: {matched.b.label}", *made_of]
    drawing.suptitle("\n".join(lines), fontsize=8, x=0.01, ha="left", parse_math=False)
    return drawing


def _draw_mark(axes: Any, y: int, mark: Mark) -> None:
    if mark.value is None:
        return
    if mark.bracket is not None:
        ends = [-mark.bracket, mark.bracket]
        axes.plot(ends, [y, y], color=PALE, linewidth=1.0, marker="|", markersize=7, zorder=1)
    if mark.low is not None and mark.high is not None:
        axes.plot([mark.low, mark.high], [y, y], color=mark.colour, linewidth=mark.width, zorder=2)
    if mark.cross is not None:
        axes.plot(mark.cross, y, marker="x", color=mark.colour, markersize=5, zorder=2)
    face = mark.colour if mark.filled else "white"
    axes.plot(mark.value, y, marker=mark.marker, color=mark.colour, markerfacecolor=face, markersize=5, zorder=3)


_LABELS_IN, _PANEL_IN, _REST_IN = 1.4, 2.3, 1.75
# Panels one below the other fit a telephone of 390 px at their own size; of each so much is not rows.
_STACKED_IN, _AXIS_IN, _KEY_IN = 3.7, 0.5, 0.7
_BETWEEN_IN, _STACKED_LETTERS = 0.12, 58


def colour_of(panel: str) -> str:
    return GROUP_COLOURS.get(panel, INK)


def published_mark(value: float | None) -> Mark:
    return Mark(value, None, None, GREY, filled=False, marker="D")


def forest_panels(
    panels: Mapping[str, Sequence[ForestRow]],
    unit: str,
    span: tuple[float, float],
    key: Mapping[str, Mark],
    counted: str = "n",
    stacked: bool = False,
) -> Figure:
    """Forest plots that share their rows and, by `span`, their axis. unit: what that shows; key: marks explained.

    counted: what stands right of each panel. stacked: one below the other, as `make_panels` has it.
    """
    figure, axes = make_panels(panels, max(len(rows) for rows in panels.values()), stacked)
    for k, (name, rows) in enumerate(panels.items()):
        draw_rows(axes[k], rows, labels=stacked or not k, head=counted)
        axes[k].set_title(name, fontsize=9, fontweight="bold", color=colour_of(name))
        axes[k].tick_params(axis="x", labelsize=8)
        if span[0] < 0.0:
            axes[k].axvline(0.0, color=GREY, linewidth=0.8)
        margin = 0.03 * (span[1] - span[0])
        axes[k].set_xlim(span[0] - margin, span[1] + margin)
    handles = [
        Line2D(
            [],
            [],
            color=mark.colour,
            marker=mark.marker,
            markersize=5,
            label=text,
            linestyle="-" if mark.low is not None else "none",
            markerfacecolor=mark.colour if mark.filled else "white",
        )
        for text, mark in key.items()
    ]
    put_key(figure, unit, handles, stacked)
    return figure


def make_panels(names: Iterable[str], rows: int, stacked: bool = False) -> tuple[Figure, Sequence[Any]]:
    """Axes side by side, or stacked: one below the other and narrow, for a telephone."""
    count, rows_in = len(list(names)), ROW_IN * max(rows, 3)
    if stacked:
        figure = Figure(figsize=(_STACKED_IN, _KEY_IN + (_AXIS_IN + rows_in) * count), layout="constrained")
        return figure, list(figure.subplots(count, 1, squeeze=False)[:, 0])
    figure = Figure(figsize=(_LABELS_IN + _PANEL_IN * count, _REST_IN + rows_in), layout="constrained")
    figure.get_layout_engine().set(w_pad=_BETWEEN_IN)  # type: ignore[call-arg, union-attr]
    return figure, figure.subplots(1, count, squeeze=False)[0]


def put_key(figure: Figure, unit: str, handles: Sequence[Any], stacked: bool = False) -> None:
    """What the axis shows and what marks mean, below the panels; stacked: in short lines."""
    if stacked:
        unit = "\n".join(wrap(unit, _STACKED_LETTERS))
    figure.legend(
        handles=handles,
        title=unit,
        loc="outside lower left",
        alignment="left",
        fontsize=7.5,
        title_fontsize=8,
        frameon=False,
        ncols=1 if stacked else len(handles),
    )


def put_title(figure: Figure, title: str, edition: str) -> None:
    figure.suptitle(f"{title}\nedition {edition}", fontsize=8, x=0.01, ha="left", parse_math=False)
