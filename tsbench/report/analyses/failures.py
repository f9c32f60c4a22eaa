"""The failure split: did it comply, did it arrive, and what ended the episodes that did not arrive.

Shares of episodes (not macro means): the classes of a row exclude each other and sum up to all of its n episodes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from tsbench.episode.outcome import Outcome
from tsbench.metrics.breakdown import COMPLETED, STRICT, Mask, panel_label
from tsbench.metrics.intervals import ClusterBootstrap, Estimate, sums_by_cluster
from tsbench.metrics.records import Records
from tsbench.report.analyses.columns import present_panels, text_columns
from tsbench.report.analyses.model import ALL, Analysis, Cell, Column, Kind, Row, Table, Value
from tsbench.report.analyses.pool import Pool
from tsbench.report.tables.forest import colour_of, make_panels, put_counts, put_key, put_title

# Okabe and Ito's colours, and hatches for print in grey.
_CLASSES = {
    "complied_arrived": ("complied,\narrived", "#009e73", ""),
    "complied_not_arrived": ("complied,\nnot arrived", "#56b4e9", "..."),
    "violated_arrived": ("violated,\narrived", "#e69f00", "///"),
    "violated_not_arrived": ("violated,\nnot arrived", "#d55e00", "xxx"),
    "error": ("error\noutcome", "#b0b0b0", ""),
}
_ENDINGS = {Outcome.COLLISION: "collision", Outcome.OFF_ROAD: "off road", Outcome.TIMEOUT: "timeout"}


@dataclass(frozen=True)
class Split:
    """Shares (%) of one planner's episodes of a group, by the keys of the table's columns."""

    n: int
    shares: Mapping[str, Estimate]


def failures(pool: Pool) -> Analysis:
    splits = {key: split for p in pool.planners for key, split in _splits(pool, p)}
    columns = [*text_columns("planner", "group", "figure"), Column("n", "n", Kind.COUNT)]
    columns += [Column(key, f"{head}, %") for key, (head, *_) in _CLASSES.items()]
    for kept in ("complied", "violated"):
        columns += [Column(f"{kept}_{end.value}", f"{kept},\n{word}, %") for end, word in _ENDINGS.items()]
    rows = []
    for (planner, group, reading), split in splits.items():
        cells: list[Cell] = [Value.of(split.shares.get(column.key)) for column in columns[4:]]
        first = reading == STRICT
        starts = first and group == ALL
        rows.append(Row((planner, group, reading, split.n, *cells), starts=starts, faint=not first))
    notes = (
        "Shares of n episodes, %, with 95 % intervals (cluster bootstrap over maps; Wilson where maps do not differ). "
        "The first five are all there is; collision, off road and timeout say what ended those that did not arrive",
        "complied: no violation of the target sign's rule up to the end of the episode, and where it arrived in a "
        "contrast scene, no needless obedience. strict: all episodes; "
        "completed: those without an error outcome",
    )
    title = pool.title("Failure split")
    table = Table(tuple(columns), tuple(rows), 4, 11)
    return Analysis("failures", title, pool.contract, table, notes, partial(_draw, pool, splits, title))


def _splits(pool: Pool, planner: str) -> Iterator[tuple[tuple[str, str, str], Split]]:
    records = pool.records[planner]
    bootstrap = ClusterBootstrap(pool.contract)
    for panel, use in records.panels().items():
        label, name = panel_label(panel), panel or ALL
        yield (planner, name, STRICT), _split(bootstrap, label, records, use, strict=True)
        if (records.error & use).any():
            whole = use & ~records.error
            yield (planner, name, COMPLETED), _split(bootstrap, label, records, whole, strict=False)


def _split(bootstrap: ClusterBootstrap, label: str, records: Records, use: Mask, strict: bool) -> Split:
    """Where it is not strict, `use` holds no error and there is no class for them."""
    # NaN of an error compares as False with both.
    complied, violated = (records.values["sign_compliant"] == k for k in (1.0, 0.0))
    arrived, ended = (records.values["destination"] == k for k in (1.0, 0.0))
    needless = complied & arrived & (records.values["scd"] == 0.0)
    complied, violated = complied & ~needless, violated | needless
    outcomes = np.array(records.outcomes)
    classes: dict[str, Mask] = {
        "complied_arrived": complied & arrived,
        "complied_not_arrived": complied & ended,
        "violated_arrived": violated & arrived,
        "violated_not_arrived": violated & ended,
    }
    if strict:
        classes["error"] = records.error
    for name, kept in (("complied", complied), ("violated", violated)):
        classes |= {f"{name}_{end.value}": kept & (outcomes == end.value) for end in _ENDINGS}

    def share(inside: Mask) -> Estimate:
        total, count = sums_by_cluster(inside[use].astype(np.float64), records.map_code[use], 0, 1)
        return bootstrap.estimate(label, total, count, 100.0, binary=True)

    return Split(int(np.count_nonzero(use)), {name: share(inside) for name, inside in classes.items()})


def _draw(pool: Pool, splits: Mapping[tuple[str, str, str], Split], title: str) -> Figure:
    names = present_panels(pool.summaries)
    rows = range(len(pool.planners))
    figure, panels = make_panels(names, len(rows))
    for k, name in enumerate(names):
        axes = panels[k]
        there = [splits.get((planner, name, STRICT)) for planner in pool.planners]
        left = np.zeros(len(rows))
        for key, (head, colour, hatch) in _CLASSES.items():
            shares = np.array([(split.shares[key].value or 0.0) if split else 0.0 for split in there])
            label = None if k else head.replace("\n", " ")
            axes.barh(
                rows, shares, 0.78, left, color=colour, hatch=hatch, edgecolor="white", lw=0.4, label=label
            )
            left += shares
        axes.set(xlim=(0.0, 100.0), ylim=(len(rows) - 0.4, -0.6))
        axes.set_title(name, fontsize=9, fontweight="bold", color=colour_of(name))
        axes.set_yticks(rows, pool.planners)
        for text in axes.get_yticklabels():
            text.set(fontsize=8, parse_math=False)
        axes.tick_params(axis="y", labelleft=not k)
        axes.tick_params(axis="x", labelsize=8)
        put_counts(axes, [str(split.n) if split else "" for split in there])
    handles, _ = panels[0].get_legend_handles_labels()
    put_key(figure, "share of episodes, % (strict); right: how many episodes", handles)
    put_title(figure, title, pool.contract)
    return figure
