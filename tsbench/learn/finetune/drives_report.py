"""`tsbench train frames`: how many frames there are of what, their targets, and ten of each group as pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from tsbench.core.errors import InputError
from tsbench.core.files import write_atomic
from tsbench.core.seeds import rng_of
from tsbench.learn.finetune.pictures import draw_frames
from tsbench.learn.finetune.recipe import FineTuning
from tsbench.learn.finetune.targets import FAMILIES
from tsbench.learn.imitation.drives import EpisodeDrive
from tsbench.learn.imitation.frames_store import FrameStore, TrainingResources
from tsbench.learn.plant2 import layout as at
from tsbench.report.charts import GREY, GROUP_COLOURS, INK, PALE, save_chart
from tsbench.report.drawing.paint import save_png
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.catalog import ScenarioType
from tsbench.signs.model import GROUPS

_PICTURES = 10
# Of a chunk this many frames of each type may become pictures.
_CANDIDATES = 4
_BESIDE_AT_M = 10
# What is kept of each frame for the figures; 8 kB of tokens are not.
_FIGURES = np.dtype(
    [("type", np.uint8), ("family", np.uint8), ("decides", np.uint8), ("speed", np.float32), ("beside", np.float32)]
)

_HISTOGRAMS = (
    ("speed", "target speed, m/s", (0.0, 20.0)),
    ("beside", "path at 10 m, m to the left (log)", (-8.0, 8.0)),
)


def report(
    drives: Sequence[EpisodeDrive], recipe: FineTuning, resources: TrainingResources, tell: Callable[[str], None]
) -> list[Path]:
    """Make the frames of all drives and write table, figure and pictures below `resources.out`; returns their paths."""
    made = 0

    def driven(count: int) -> None:
        nonlocal made
        made += count
        tell(f"{made} of {len(drives)} drives")

    source = recipe.source()
    store = FrameStore(resources, drives, source, recipe.seed, driven)
    figures, candidates = [], []
    for chunk in range(len(store)):
        frames = store.load([chunk])
        figures.append(_figures_of(frames))
        candidates.append(_drawn(frames, rng_of("frames", "pictures", recipe.seed, chunk)))
    found = np.concatenate(figures) if figures else np.zeros(0, dtype=_FIGURES)
    if not len(found):
        raise InputError("none of the drives obeyed and arrived: there are no frames to look at")
    out, types = resources.out, DataSet().catalog.types
    paths = [out / "frames.md", out / "frames.png"]
    write_atomic(paths[0], _table(found, drives, types).encode())
    save_chart(lambda: _chart(found, types), paths[1])
    for group in GROUPS:
        kinds = [k for k, kind in enumerate(types) if kind.group == group]
        chosen = _of_group(np.concatenate(candidates), kinds)
        if len(chosen):
            paths.append(out / f"frames-{group}.png")
            save_png(paths[-1], draw_frames(chosen, types, source.vocabulary))
    return paths


def _figures_of(frames: at.Records) -> at.Records:
    found: at.Records = np.zeros(len(frames), dtype=_FIGURES)
    for name in ("type", "family", "decides", "speed"):
        found[name] = frames[name]
    last = _BESIDE_AT_M - 1
    found["beside"] = np.where(frames["path_known"][:, last] == 1, frames["path"][:, last, 1], np.nan)
    return found


def _drawn(frames: at.Records, rng: np.random.Generator) -> at.Records:
    """A few frames of each type, of decisions above all."""
    order = rng.permutation(len(frames))
    order = order[np.argsort(-frames["decides"][order].astype(int), kind="stable")]
    rows = [order[frames["type"][order] == kind][:_CANDIDATES] for kind in np.unique(frames["type"])]
    return frames[np.concatenate(rows)] if rows else frames[:0]


def _of_group(frames: at.Records, kinds: Sequence[int]) -> list[at.Record]:
    by_type = [frames[frames["type"] == k] for k in kinds]
    longest = max(map(len, by_type))
    return [rows[k] for k in range(longest) for rows in by_type if k < len(rows)][:_PICTURES]


def _table(found: at.Records, drives: Sequence[EpisodeDrive], types: Sequence[ScenarioType]) -> str:
    lines = [
        "| type | group | family | drives | frames | in decision windows | target 0 to 0.5 m/s | mean target, m/s |",
        "|---|---|---|---|---|---|---|---|",
    ]
    driven = [drive.spec.scenario_type for drive in drives]
    for k, kind in enumerate(types):
        rows = found[found["type"] == k]
        if len(rows):
            stands = 100.0 * (rows["speed"] < 0.5).mean()
            lines.append(
                f"| {kind.id} | {kind.group} | {FAMILIES[rows['family'][0]]} | {driven.count(kind.id):,} "
                f"| {len(rows):,} | {100.0 * rows['decides'].mean():.0f} % | {stands:.1f} % "
                f"| {rows['speed'].mean():.1f} |"
            )
    lines.append(f"| all | | | {len(drives):,} | {len(found):,} | {100.0 * found['decides'].mean():.0f} % | | |")
    return "\n".join(lines) + "\n"


def _chart(found: at.Records, types: Sequence[ScenarioType]) -> Figure:
    there = [k for k in range(len(types)) if (found["type"] == k).any()]
    figure = Figure(figsize=(9.0, 1.6 + 0.2 * max(len(there), 12)), layout="constrained")
    grid = figure.add_gridspec(len(FAMILIES), 3, width_ratios=(1.3, 1.0, 1.0))
    counts = figure.add_subplot(grid[:, 0])
    for place, k in enumerate(reversed(there)):
        rows = found[found["type"] == k]
        counts.barh(place, len(rows), color=PALE)
        counts.barh(place, int(rows["decides"].sum()), color=GROUP_COLOURS[types[k].group])
    counts.set_yticks(range(len(there)), [types[k].id for k in reversed(there)], fontsize="x-small")
    counts.set_title("frames; coloured: in decision windows", loc="left", fontsize="small")
    counts.tick_params(axis="x", labelsize="x-small")
    for row, family in enumerate(FAMILIES):
        for column, (name, title, (low, high)) in enumerate(_HISTOGRAMS):
            axes = figure.add_subplot(grid[row, 1 + column])
            values = found[name][found["family"] == row]
            values = np.clip(values[np.isfinite(values)], low, high)
            axes.hist(values, bins=40, range=(low, high), color=INK, log=name == "beside")
            axes.set_yticks([])
            axes.tick_params(labelsize="x-small", labelbottom=row == len(FAMILIES) - 1)
            axes.set_ylabel(family if column == 0 else "", fontsize="xx-small", color=GREY)
            if row == 0:
                axes.set_title(title, loc="left", fontsize="small")
    for axes in figure.axes:
        axes.spines[["top", "right"]].set_visible(False)
    return figure
