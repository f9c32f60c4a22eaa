"""How near traffic comes to nuPlan's: KS distances, and the CDFs as a figure; of a data set, and of a report's runs.

`tsbench scenarios calibration` drives scenes anew to see all cars. A report (`traffic`) takes the initial speeds of the
run's scenarios, realised densities from their certificates, and speeds of cars in sight of the ego in traced episodes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from tsbench.episode.trace import Trace, read_trace
from tsbench.geometry.polyline import Array
from tsbench.metrics.calibration import (
    GOAL,
    MOVING_MPS,
    SPEEDS_EVERY_TICKS,
    SPEEDS_OVER_S,
    Fit,
    calibrate,
    grid_speeds,
    sample_rows,
)
from tsbench.report.analyses.analysis import Analysis, Row, Table
from tsbench.report.analyses.columns import count_columns, number_columns, text_columns
from tsbench.report.analyses.run_pool import EpisodeIndex, RunPool
from tsbench.run.edition import contract_now, standing_contract
from tsbench.scenarios.certificates import certificates_of
from tsbench.sim.world import DT_S

_OURS, _NUPLAN = "#d55e00", "#0072b2"
_BREAK = ":\n"
_JUDGED = {None: "no goal", True: "met", False: "missed"}


def calibration(fits: Sequence[Fit], split: str | None) -> Analysis:
    """One row for each quantity. split: whose scenarios they are of, None: all that are there."""
    columns = (
        *text_columns("quantity", "unit"),
        *count_columns("n"),
        *number_columns(3, ks="KS"),
        *text_columns(goal=f"at most\n{GOAL:.2f}"),
    )
    rows = tuple(
        Row((fit.quantiles.name, fit.quantiles.unit, len(fit.sample), fit.distance, _JUDGED[fit.good])) for fit in fits
    )
    whose = f"{split} split" if split else "all splits"
    title = f"Calibration of traffic: scenarios ({whose}) against nuPlan"
    notes = (
        "KS: Kolmogorov-Smirnov distance between the scenarios' values and nuPlan's published quantiles, whose CDF is "
        "taken as linear between them; nothing is compared beyond the outermost",
    )
    draw = partial(_draw, fits, title)
    return Analysis("calibration", title, "", Table(columns, rows, 1), notes, draw, partial(draw, stacked=True))


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
        axes.set_title(f"{q.name}{_BREAK if stacked else ': '}KS {fit.distance:.3f}", fontsize=9)
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


_EPISODES = 40
_BACKGROUND = "bg_"


def traffic(pool: RunPool, index: EpisodeIndex) -> Analysis | None:
    """The calibration of a pool's traffic; None where it cannot be told.

    That is so for scenarios that are not those of this tsbench, without certificates, or without traced traffic.
    """
    split, data = str(pool.runs[0].manifest["effective"]["split"]), pool.runs[0].data
    if split not in data.splits or not data.certificates_path.is_file():
        return None
    table = data.table(split)
    if standing_contract(contract_now(data, split)) != pool.contract:
        return None
    driven = set(index.columns["scenario_id"])
    rows = [spec for spec in table if spec.scenario_id in driven]
    traced: dict[str, int] = {}
    for row in index.traced:
        traced.setdefault(index.columns["scenario_id"][row], row)
    sample = sample_rows([spec for spec in rows if spec.scenario_id in traced], _EPISODES)
    cruise = background_speeds(read_trace(index.trace(traced[spec.scenario_id])) for spec in sample)
    proven = (c for c in certificates_of(data) if c.scenario_id in driven)
    densities = np.array([c.realised_density for c in proven if c.asked_density])
    initial = grid_speeds(rows)
    if not (len(initial) and len(cruise) and len(densities)):
        return None
    whole = len(rows) == len(table)
    fits = calibrate(initial, cruise, densities)
    share = split if whole else f"{len(rows):,} of {len(table):,} of the {split}"
    found = calibration(fits if whole else unjudged(fits), share)
    note = (
        f"only the {len(rows):,} scenarios of this page; cruise speed: moving background cars in sight of the ego in "
        f"the first {SPEEDS_OVER_S:.0f} s of {len(sample)} traced episodes, so a planner's own driving has a part in it"
    )
    return replace(found, notes=(note, *found.notes))


def unjudged(fits: Sequence[Fit]) -> list[Fit]:
    """The same without a verdict: the goal is one for the whole of a split, a part of it need not look like nuPlan."""
    return [replace(fit, good=None) for fit in fits]


def background_speeds(traces: Iterable[Trace]) -> Array:
    """Speeds (m,) of moving background cars in sight, m/s, at the moments that the calibration looks at."""
    found = [np.zeros(0)]
    for trace in traces:
        names = trace.snapshots[-1].actors.table.ids
        background = np.array([name.startswith(_BACKGROUND) for name in names], dtype=bool)
        for snapshot in trace.snapshots[: round(SPEEDS_OVER_S / DT_S) : SPEEDS_EVERY_TICKS]:
            actors = snapshot.actors
            found.append(actors.speed[background[actors.index]] if len(actors) else np.zeros(0))
    speeds = np.concatenate(found)
    return speeds[(speeds >= MOVING_MPS[0]) & (speeds <= MOVING_MPS[1])]
