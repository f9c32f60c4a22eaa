"""Rows that a training writes as it goes, a line of JSON each, and the learning curve that is drawn from them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from matplotlib.figure import Figure

from tsbench.core.files import write_atomic
from tsbench.report.charts import GREY, INK, save_chart

Row = Mapping[str, float]

# A row per rollout, or per epoch: how the network drives. A row per window of an imitation: means of the losses.
CURVE, LOSSES, PICTURE = "curve.jsonl", "losses.jsonl", "curve.png"
_ENDS = {"arrived": "#0072B2", "collision": "#D55E00", "off_road": "#E69F00", "timeout": GREY}
_TERMS = {"path": INK, "waypoints": "#0072B2", "speed": "#D55E00", "forecast": "#E69F00"}


def add_row(path: Path, row: Row, key: str) -> None:
    """Put a row behind those with a smaller `key`.

    Others go: a training that was broken off wrote them after its last checkpoint.
    """
    kept = [one for one in read_rows(path) if one[key] < row[key]]
    write_atomic(path, "".join(json.dumps(one) + "\n" for one in [*kept, row]).encode())


def read_rows(path: Path) -> list[Row]:
    """The rows of a file; none without a file."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    return [json.loads(line) for line in lines]


def draw_rl(out: Path) -> Path | None:
    """Ends of the last 200 training episodes and their mean reward over the steps; None before the first row."""
    rows = read_rows(out / CURVE)
    if not rows:
        return None
    save_chart(lambda: _rl_figure(rows), out / PICTURE)
    return out / PICTURE


def _rl_figure(rows: list[Row]) -> Figure:
    steps = [row["steps"] / 1000.0 for row in rows]
    figure = Figure(figsize=(7.0, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot(steps, [row["reward"] for row in rows], color=INK)
    left.set_title("mean reward per episode", loc="left", fontsize="medium")
    for name, colour in _ENDS.items():
        right.plot(steps, [100.0 * row[name] for row in rows], color=colour, label=name.replace("_", " "))
    right.set_title("% of the last 200 episodes", loc="left", fontsize="medium")
    right.set_ylim(0.0, 100.0)
    right.legend(frameon=False, fontsize="small")
    for axes in (left, right):
        axes.set_xlabel("thousand decisions")
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def draw_imitation(out: Path) -> None:
    """Write `curve.png`: the losses over the steps, and how the network drives after each epoch."""
    losses, skills = read_rows(out / LOSSES), read_rows(out / CURVE)
    save_chart(lambda: _imitation_figure(losses, skills), out / PICTURE)


def _imitation_figure(losses: list[Row], skills: list[Row]) -> Figure:
    figure = Figure(figsize=(7.0, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for name, colour in _TERMS.items():
        rows = [row for row in losses if name in row]
        left.plot([row["steps"] / 1000.0 for row in rows], [row[name] for row in rows], color=colour, label=name)
    left.set(xlabel="thousand steps", yscale="log")
    left.set_title("losses", loc="left", fontsize="medium")
    epochs = [row["epoch"] for row in skills]
    for name, colour in {"scd": INK, **_ENDS}.items():
        label = "SCD" if name == "scd" else name.replace("_", " ")
        right.plot(epochs, [100.0 * row[name] for row in skills], color=colour, marker=".", label=label)
    right.set(xlabel="epoch", ylim=(0.0, 100.0), xticks=epochs)
    right.set_title("% of the episodes on kept-out maps", loc="left", fontsize="medium")
    for axes in (left, right):
        axes.legend(frameon=False, fontsize="small")
        axes.spines[["top", "right"]].set_visible(False)
    return figure
