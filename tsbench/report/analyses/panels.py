"""Figures of several panels side by side: one for all types, one for each group; planners or metrics as rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tsbench.report.tables.charts import GREY, GROUP_COLOURS, INK
from tsbench.report.tables.forest import ROW_IN, ForestRow, Mark, draw_rows

ALL = "all types"
_LABELS_IN, _PANEL_IN, _REST_IN = 1.4, 2.3, 1.75


def colour_of(panel: str) -> str:
    """That of a group; ink for what is over all of them."""
    return GROUP_COLOURS.get(panel, INK)


def published_mark(value: float | None) -> Mark:
    """A published figure beside one's own."""
    return Mark(value, None, None, GREY, filled=False, marker="D")


def forest_panels(
    panels: Mapping[str, Sequence[ForestRow]],
    unit: str,
    span: tuple[float, float] | None,
    key: Mapping[str, Mark],
) -> Figure:
    """Forest plots that share their rows and, by `span`, their axis. unit: what that shows; key: marks explained."""
    figure, axes = make_panels(panels, max(len(rows) for rows in panels.values()))
    for k, (name, rows) in enumerate(panels.items()):
        draw_rows(axes[k], rows, labels=not k)
        axes[k].set_title(name, fontsize=9, fontweight="bold", color=colour_of(name))
        axes[k].tick_params(axis="x", labelsize=8)
        if span is None or span[0] < 0.0:
            axes[k].axvline(0.0, color=GREY, linewidth=0.8)
        if span is not None:
            margin = 0.03 * (span[1] - span[0])
            axes[k].set_xlim(span[0] - margin, span[1] + margin)
    handles = [
        Line2D(
            [], [], color=mark.colour, marker=mark.marker, markersize=5, label=text,
            linestyle="-" if mark.low is not None else "none", markerfacecolor=mark.colour if mark.filled else "white",
        )
        for text, mark in key.items()
    ]  # fmt: skip
    put_key(figure, unit, handles)
    return figure


def make_panels(names: Mapping[str, object], rows: int) -> tuple[Figure, Sequence[Any]]:
    """An empty figure with one axes for each name."""
    size = (_LABELS_IN + _PANEL_IN * len(names), _REST_IN + ROW_IN * max(rows, 3))
    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots(1, len(names), squeeze=False)[0]


def put_key(figure: Figure, unit: str, handles: Sequence[Any]) -> None:
    """Below the panels: what their axes show, and what the marks mean."""
    figure.legend(
        handles=handles, title=unit, loc="outside lower left", alignment="left", fontsize=7.5, title_fontsize=8,
        frameon=False, ncols=len(handles),
    )  # fmt: skip


def put_title(figure: Figure, title: str, contract: str) -> None:
    """Title and contract above everything, at the left."""
    figure.suptitle(f"{title}\ncontract {contract}", fontsize=8, x=0.01, ha="left", parse_math=False)
