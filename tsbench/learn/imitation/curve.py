"""The learning curve of a training by imitation: its rows, and their picture."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from tsbench.learn.rows import Row, read_rows
from tsbench.report.tables.charts import GREY, INK, save_chart

# A row per epoch: how the network drives on kept-out maps. A row per window: means of the losses.
SKILLS, LOSSES, PICTURE = "curve.jsonl", "losses.jsonl", "curve.png"
_SHARES = {"scd": INK, "arrived": "#0072B2", "collision": "#D55E00", "off_road": "#E69F00", "timeout": GREY}
_TERMS = {"path": INK, "waypoints": "#0072B2", "speed": "#D55E00", "forecast": "#E69F00"}


def draw_curve(out: Path) -> None:
    """Write `curve.png`: the losses over the steps, and how the network drives after each epoch."""
    losses, skills = read_rows(out / LOSSES), read_rows(out / SKILLS)
    save_chart(lambda: _figure(losses, skills), out / PICTURE)


def _figure(losses: list[Row], skills: list[Row]) -> Figure:
    figure = Figure(figsize=(7.0, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for name, colour in _TERMS.items():
        rows = [row for row in losses if name in row]
        left.plot(
            [row["steps"] / 1000.0 for row in rows], [row[name] for row in rows], color=colour, label=name
        )
    left.set(xlabel="thousand steps", yscale="log")
    left.set_title("losses", loc="left", fontsize="medium")
    epochs = [row["epoch"] for row in skills]
    for name, colour in _SHARES.items():
        label = "SCD" if name == "scd" else name.replace("_", " ")
        right.plot(epochs, [100.0 * row[name] for row in skills], color=colour, marker=".", label=label)
    right.set(xlabel="epoch", ylim=(0.0, 100.0), xticks=epochs)
    right.set_title("% of the episodes on kept-out maps", loc="left", fontsize="medium")
    for axes in (left, right):
        axes.legend(frameon=False, fontsize="small")
        axes.spines[["top", "right"]].set_visible(False)
    return figure
