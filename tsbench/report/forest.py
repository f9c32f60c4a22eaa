"""The forest plot of a comparison: the difference in SCD of each type, group and overall, with its interval."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tsbench.metrics.compare import PairedFigure
from tsbench.report.compare import Matched
from tsbench.run.files import replacing, told_plainly

_ROW_IN, _MARGIN_IN, _WIDTH_IN, _DPI = 0.24, 1.9, 9.0, 150
_COLOURS = {"priority": "#1f77b4", "speed": "#d62728", "obstacles": "#e08a00", "routing": "#2ca02c"}
_PLAIN = "#303030"


def draw_forest(matched: Matched, path: Path) -> None:
    """Write the PNG. Full marks are significant; grey brackets show what the others would have found (MDE)."""
    c = matched.comparison
    rows = [("all types", c.overall, _PLAIN, True)]
    for group, figure in c.groups.items():
        colour = _COLOURS.get(group, _PLAIN)
        rows.append((group, figure, colour, True))
        rows += [(kind, c.types[kind], colour, False) for kind, g in c.type_groups.items() if g == group]
    drawing = Figure(figsize=(_WIDTH_IN, _MARGIN_IN + _ROW_IN * len(rows)), layout="constrained")
    FigureCanvasAgg(drawing)
    axes = drawing.subplots()
    for y, (_, figure, colour, mean) in enumerate(rows):
        _mark(axes, y, figure, colour, mean)
    axes.axvline(0.0, color="#808080", linewidth=0.8)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_yticks(range(len(rows)), [name if mean else f"{name}  " for name, _, _, mean in rows])
    for label, (_, _, _, mean) in zip(axes.get_yticklabels(), rows, strict=True):
        label.set(fontweight="bold" if mean else "normal", fontsize=8, parse_math=False)
    counts = axes.secondary_yaxis("right")
    counts.set_yticks(range(len(rows)), [_counted(figure) for _, figure, _, _ in rows])
    counts.tick_params(length=0, labelsize=7)
    axes.grid(axis="x", color="#e4e4e4", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.set_xlabel(
        "SCD of B minus SCD of A, percentage points (strict), 95 % paired cluster bootstrap over maps\n"
        "full: significant (exact McNemar, types after Holm); grey: minimum detectable effect; right: lost/won of n\n"
        "x: completed only, pairs without an error outcome; their n in brackets",
        fontsize=7.5,
    )
    lines = [*matched.warnings, f"A: {matched.a.label}", f"B: {matched.b.label}", _contract_line(matched)]
    drawing.suptitle("\n".join(lines), fontsize=8, x=0.01, ha="left", parse_math=False)
    with told_plainly(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as part:
            drawing.savefig(part, dpi=_DPI, format="png")


def _mark(axes: Any, y: int, figure: PairedFigure, colour: str, mean: bool) -> None:
    d = figure.main
    if d.value is None:
        return
    if d.mde is not None:
        axes.plot([-d.mde, d.mde], [y, y], color="#c4c4c4", linewidth=1.0, marker="|", markersize=7, zorder=1)
    if d.low is not None and d.high is not None:
        axes.plot([d.low, d.high], [y, y], color=colour, linewidth=2.2 if mean else 1.4, zorder=2)
    if figure.completed.n != d.n and figure.completed.value is not None:
        axes.plot(figure.completed.value, y, marker="x", color=colour, markersize=5, zorder=2)
    face = colour if d.significant else "white"
    axes.plot(
        d.value, y, marker="D" if mean else "o", color=colour, markerfacecolor=face, markersize=5, zorder=3
    )


def _counted(figure: PairedFigure) -> str:
    d = figure.main
    text = f"{d.lost or 0}/{d.won or 0} of {d.n}"
    return text if d.n == figure.completed.n else f"{text} ({figure.completed.n})"


def _contract_line(matched: Matched) -> str:
    a, b = matched.contracts
    return f"contract {a}" if a == b else f"contracts A {a[:24]}…, B {b[:24]}…"
