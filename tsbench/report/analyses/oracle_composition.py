"""The oracle's composition: whose drives are learned from, by group, and how many scenarios have one.

Reference: docs/oracle.md, "What is in it": 36,828 drives of 23,200 scenarios, 29,462 to train and 7,366 to validate on.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import cycle
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from tsbench.report.analyses.analysis import ALL, Analysis, Cell, Row, Table
from tsbench.report.analyses.columns import count_columns, in_published_order, number_columns, published, text_columns
from tsbench.report.charts import INK
from tsbench.report.forest import put_counts
from tsbench.signs.model import GROUPS

PUBLISHED_DRIVES, PUBLISHED_SCENARIOS = 36_828, 23_200
# Experts of the IDM kind in blues, from the plain one to the fast style; those with networks in Okabe and Ito's.
_BLUES = ("#08306b", "#2171b5", "#4f9bd0", "#8fc1e3", "#c9dff0")
_OTHERS = ("#d55e00", "#009e73", "#cc79a7", "#e69f00", "#808080")
# Shares (%) from which on there is room for the number in the bar.
_WRITTEN = 4.0
_DARK = ("#08306b", "#2171b5", "#d55e00", "#009e73", "#808080")


class RankedDrive(NamedTuple):
    """A drive of the oracle. rank: 1 = the best of its scenario; seconds: driven."""

    scenario_id: str
    group: str
    planner: str
    rank: int
    part: str
    seconds: float


def composition(drives: Sequence[RankedDrive], scenarios: Mapping[str, int], split: str) -> Analysis:
    """One block for all types and for each group. scenarios: how many the split has, by group."""
    planners = in_published_order({d.planner for d in drives})
    columns = (
        *text_columns("group", planner="expert"),
        *count_columns("drives"),
        *number_columns(share="share of\ndrives, %"),
        *count_columns(first="best of\nscenario"),
        *number_columns(hours="driven,\nh"),
        *count_columns("scenarios", covered="with a\ndrive"),
        *number_columns(2, coverage="with a\ndrive, %", per_scenario="drives per\nscenario"),
    )
    rows: list[Row] = []
    for group in _groups(scenarios):
        own = [d for d in drives if group in (ALL, d.group)]
        rows.append(Row(_block(group, own, _size(scenarios, group)), starts=True))
        if group == ALL:
            per = PUBLISHED_DRIVES / PUBLISHED_SCENARIOS
            published: tuple[Cell, ...] = (ALL, "published", PUBLISHED_DRIVES, None, None, None)
            rows.append(Row((*published, PUBLISHED_SCENARIOS, None, None, per), faint=True))
        rows += [Row(_line(group, name, own)) for name in planners]
    parts = Counter(d.part for d in drives)
    notes = (
        "Of each scenario the best two successful drives by speed and comfort; of the experts without a network only "
        "the fastest. Coverage and drives per scenario are over all scenarios of the split",
        f"By part: {', '.join(f'{count:,} {part}' for part, count in sorted(parts.items())) or 'none'}. "
        "Published: 29,462 to train, 7,366 to validate on, of its own scenarios and experts",
    )
    title = f"Composition of the oracle: {len(drives):,} drives, {split} split ({_size(scenarios, ALL):,} scenarios)"
    table = Table(columns, tuple(rows), 2)
    return Analysis("oracle", title, "", table, notes, partial(_draw, drives, scenarios, planners, title))


def _groups(scenarios: Mapping[str, int]) -> tuple[str, ...]:
    return (ALL, *(group for group in GROUPS if group in scenarios))


def _size(scenarios: Mapping[str, int], group: str) -> int:
    return sum(scenarios.values()) if group == ALL else scenarios[group]


def _covered(drives: Sequence[RankedDrive]) -> int:
    return len({d.scenario_id for d in drives})


def _hours(drives: Sequence[RankedDrive]) -> float:
    return sum(d.seconds for d in drives) / 3600.0


def _block(group: str, drives: Sequence[RankedDrive], size: int) -> tuple[Cell, ...]:
    covered = _covered(drives)
    share, mean = 100.0 * covered / size, len(drives) / size
    whole = 100.0 if drives else None
    return group, "all experts", len(drives), whole, covered, _hours(drives), size, covered, share, mean


def _line(group: str, planner: str, drives: Sequence[RankedDrive]) -> tuple[Cell, ...]:
    own = [d for d in drives if d.planner == planner]
    share = 100.0 * len(own) / len(drives) if drives else None
    first = sum(d.rank == 1 for d in own)
    return group, planner, len(own), share, first, _hours(own), None, None, None, None


def _draw(drives: Sequence[RankedDrive], scenarios: Mapping[str, int], planners: Sequence[str], title: str) -> Figure:
    groups, blues, others = _groups(scenarios), cycle(_BLUES), cycle(_OTHERS)
    # The same colour for the same expert in all figures.
    known = in_published_order({*planners, *(name for name in published() if name.endswith("-e"))})
    colours = {name: next(blues if name.startswith("idm") else others) for name in known}
    own = {group: [d for d in drives if group in (ALL, d.group)] for group in groups}
    figure = Figure(figsize=(9.0, 1.6 + 0.5 * len(groups)), layout="constrained")
    axes = figure.subplots()
    left = np.zeros(len(groups))
    for name in planners:
        counts = [sum(d.planner == name for d in own[group]) for group in groups]
        shares = np.array([100.0 * n / max(len(own[g]), 1) for n, g in zip(counts, groups, strict=True)])
        axes.barh(range(len(groups)), shares, 0.74, left, color=colours[name], edgecolor="white", lw=0.6, label=name)
        ink = "white" if colours[name] in _DARK else INK
        for k, share in enumerate(shares):
            if share >= _WRITTEN:
                place = (left[k] + share / 2, k)
                axes.text(*place, f"{share:.0f}", ha="center", va="center", fontsize=8, color=ink)
        left += shares
    axes.set(xlim=(0.0, 100.0), ylim=(len(groups) - 0.5, -0.5))
    axes.set_yticks(range(len(groups)), groups, fontsize=9)
    axes.set_xlabel("share of the group's drives, %; right: drives, per scenario, scenarios with one", fontsize=8)
    axes.tick_params(axis="x", labelsize=8)
    axes.spines[["top", "right", "left"]].set_visible(False)
    put_counts(axes, [_told(own[group], _size(scenarios, group)) for group in groups], size=8)
    figure.legend(loc="outside lower left", fontsize=8, frameon=False, ncols=max(len(planners), 1))
    figure.suptitle(title, fontsize=8, x=0.01, ha="left")
    return figure


def _told(drives: Sequence[RankedDrive], size: int) -> str:
    return f"{len(drives):,}  ·  {len(drives) / size:.2f}  ·  {100.0 * _covered(drives) / size:.1f} %"
