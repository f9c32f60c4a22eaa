"""How near the scenarios' traffic comes to nuPlan's: KS distances, and the CDFs as a figure."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from tsbench.dataset.scenes.calibration import GOAL, Fit
from tsbench.report.analyses.model import Analysis, Column, Kind, Row, Table

_OURS, _NUPLAN = "#d55e00", "#0072b2"
_BREAK = ":\n"
_JUDGED = {None: "no goal", True: "met", False: "missed"}


def calibration(fits: Sequence[Fit], split: str | None) -> Analysis:
    """One row for each quantity. split: whose scenarios they are of, None: all that are there."""
    columns = (
        Column("quantity", "quantity", Kind.TEXT), Column("unit", "unit", Kind.TEXT), Column("n", "n", Kind.COUNT),
        Column("ks", "KS", Kind.NUMBER, 3), Column("near", f"at most\n{GOAL:.2f}", Kind.TEXT),
        Column("ks_levels", "KS at the\ngrid's levels", Kind.NUMBER, 3),
        Column("goal", f"at most\n{GOAL:.2f} there", Kind.TEXT),
    )  # fmt: skip
    rows = tuple(
        Row((
            fit.quantiles.name, fit.quantiles.unit, len(fit.sample), fit.distance, _JUDGED[fit.near],
            None if fit.good is None else fit.at_probes, _JUDGED[fit.good],
        ))
        for fit in fits
    )  # fmt: skip
    whose = f"{split} split" if split else "all splits"
    title = f"Calibration of traffic: scenarios ({whose}) against nuPlan"
    notes = (
        "KS: Kolmogorov-Smirnov distance between the scenarios' values and nuPlan's published quantiles, whose CDF is "
        "taken as linear between them; nothing is compared beyond the outermost",
        "the grid's levels: nuPlan's 25, 50 and 75 %, to the nearest of which both are rounded there",
    )
    return Analysis(
        "calibration",
        title,
        "",
        Table(columns, rows, 1),
        notes,
        partial(_draw, fits, title),
        partial(_draw, fits, title, stacked=True),
    )


def _draw(fits: Sequence[Fit], title: str, stacked: bool = False) -> Figure:
    """Panels side by side, or stacked: one below the other, for a telephone."""
    size = (3.7, 3.0 * len(fits)) if stacked else (4.2 * len(fits), 3.8)
    figure = Figure(figsize=size, layout="constrained")
    panels = figure.subplots(*((len(fits), 1) if stacked else (1, len(fits))), squeeze=False).ravel()
    for axes, fit in zip(panels, fits, strict=True):
        q, n = fit.quantiles, len(fit.sample)
        share = np.arange(1, n + 1) / n
        axes.step(fit.sample, share, where="post", color=_OURS, linewidth=2.0, label=f"scenarios (n = {n})")
        axes.plot(q.value, q.share, "o--", color=_NUPLAN, markersize=4, label="nuPlan, published quantiles")
        told = f"KS {fit.distance:.3f}"
        if fit.good is not None:
            told += f", at the grid's levels {fit.at_probes:.3f}"
        axes.set_title(f"{q.name}{_BREAK if stacked else ': '}{told}", fontsize=9)
        axes.set_xlabel(q.unit, fontsize=8)
        axes.set_ylim(0.0, 1.0)
        axes.tick_params(labelsize=8)
        axes.grid(color="#e4e4e4", linewidth=0.6)
        axes.legend(fontsize=7.5, loc="lower right")
    for axes in panels if stacked else panels[:1]:
        axes.set_ylabel("share of values below", fontsize=8)
    if not stacked:
        figure.suptitle(title, fontsize=8, x=0.01, ha="left")
    return figure
