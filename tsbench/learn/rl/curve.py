"""The learning curve of a training as a picture, from the rows that it has written."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from tsbench.learn.rows import Row, read_rows
from tsbench.report.tables.charts import GREY, INK, save_chart

CURVE, PICTURE = "curve.jsonl", "curve.png"
_SHARES = {"arrived": "#0072B2", "collision": "#D55E00", "off_road": "#E69F00", "timeout": GREY}


def draw_curve(out: Path) -> Path | None:
    """Ends of the last 200 training episodes and their mean reward over the steps; None before the first row."""
    rows = read_rows(out / CURVE)
    if not rows:
        return None
    save_chart(lambda: _figure(rows), out / PICTURE)
    return out / PICTURE


def _figure(rows: list[Row]) -> Figure:
    steps = [row["steps"] / 1000.0 for row in rows]
    figure = Figure(figsize=(7.0, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot(steps, [row["reward"] for row in rows], color=INK)
    left.set_title("mean reward per episode", loc="left", fontsize="medium")
    for name, colour in _SHARES.items():
        right.plot(steps, [100.0 * row[name] for row in rows], color=colour, label=name.replace("_", " "))
    right.set_title("% of the last 200 episodes", loc="left", fontsize="medium")
    right.set_ylim(0.0, 100.0)
    right.legend(frameon=False, fontsize="small")
    for axes in (left, right):
        axes.set_xlabel("thousand decisions")
        axes.spines[["top", "right"]].set_visible(False)
    return figure
