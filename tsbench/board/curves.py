"""The figures of the site: paired SCD of planners, of one over perception levels, and over cities; as large on a
telephone.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from functools import partial

from markupsafe import Markup
from matplotlib.figure import Figure as Drawing

from tsbench.board.submission import Figure
from tsbench.report.charts import GREY, GROUP_COLOURS, INK, inline_svg
from tsbench.report.forest import ForestRow, Mark, draw_rows

# Inches of 72 points, which are 96 px: 340 px.
_WIDTH, _HEIGHT = 3.54, 2.3
_ROWS, _ROW = 0.75, 0.28
# Characters of a name that stands beside its row.
_NAME = 34
_COLOUR = GROUP_COLOURS["priority"]
Point = tuple[str, Figure]
# `Figure.over` of a mean over a planner's seeds: its ends are one standard deviation away.
SEEDS = "seeds"


def curve(points: Sequence[Point], floor: Point | None, name: str, title: str) -> Markup:
    """Values by perception level with their intervals, as inline SVG. floor: the planner without plates, dashed.

    name: unique among the figures of the page. title: the alternative text for screen readers, before the values.
    """
    said = f"{title}: {'; '.join(f'{level} {_words(figure)}' for level, figure in points)}"
    if floor is not None:
        said += f"; floor {floor[0]} {_words(floor[1])}"
    return inline_svg(partial(_curve, points, floor), name, said)


def forest(points: Sequence[Point], name: str, title: str, floors: Container[str] = ()) -> Markup:
    """Values by planner or city with their intervals, one row each; the rest as `curve`. floors: names in grey."""
    said = f"{title}: {'; '.join(f'{of} {_words(figure)}' for of, figure in points)}"
    return inline_svg(partial(_forest, points, floors), name, said)


def _curve(points: Sequence[Point], floor: Point | None) -> Drawing:
    drawing = Drawing(figsize=(_WIDTH, _HEIGHT), layout="constrained")
    axes = drawing.subplots()
    if floor is not None and floor[1].value is not None:
        axes.axhline(floor[1].value, color=GREY, linewidth=1.2, linestyle=(0, (4, 3)))
        axes.annotate(
            f"floor: {floor[0]}",
            (0.0, floor[1].value),
            (2, 3),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            fontsize=8,
            color=GREY,
        ).set(parse_math=False)
    known = [(x, figure.value, figure) for x, (_, figure) in enumerate(points) if figure.value is not None]
    axes.plot([x for x, _, _ in known], [v for _, v, _ in known], "o-", color=_COLOUR, markersize=5, linewidth=1.6)
    for x, top, figure in known:
        if figure.low is not None and figure.high is not None:
            axes.plot([x, x], [figure.low, figure.high], color=_COLOUR, linewidth=1.2)
            top = figure.high
        axes.annotate(
            f"{figure.value:.1f}", (x, top), (0, 4), textcoords="offset points", ha="center", fontsize=8.5, color=INK
        )
    axes.set_xticks(range(len(points)), [level for level, _ in points])
    for label in axes.get_xticklabels():
        label.set(parse_math=False)
    axes.set(xlim=(-0.45, len(points) - 0.55), ylim=(-3.0, 118.0), yticks=(0, 25, 50, 75, 100))
    axes.tick_params(labelsize=8.5)
    axes.grid(axis="y", color="#e4e4e4", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    return drawing


def _forest(points: Sequence[Point], floors: Container[str]) -> Drawing:
    drawing = Drawing(figsize=(_WIDTH, _ROWS + _ROW * len(points)), layout="constrained")
    axes = drawing.subplots()
    rows = []
    for of, figure in points:
        name = of if len(of) <= _NAME else f"{of[: _NAME - 1]}…"
        mark = Mark(figure.value, figure.low, figure.high, GREY if of in floors else _COLOUR)
        rows.append(ForestRow(name, (mark,), "–" if figure.value is None else f"{figure.value:.1f}"))
    draw_rows(axes, rows)
    axes.set(xlim=(-3.0, 103.0), xticks=(0, 25, 50, 75, 100))
    axes.tick_params(axis="x", labelsize=8.5)
    axes.spines[["top", "right"]].set_visible(False)
    return drawing


def _words(figure: Figure) -> str:
    if figure.value is None:
        return "unknown"
    ends = "standard deviation" if figure.over == SEEDS else "95 % interval"
    interval = "" if figure.low is None else f" ({ends} {figure.low:.1f} to {figure.high:.1f})"
    return f"{figure.value:.1f} %{interval}"
