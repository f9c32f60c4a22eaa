"""Paired SCD over perception levels: what wrong perception costs each planner. Source: docs/perception.md."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import groupby
from pathlib import Path

from matplotlib.figure import Figure

from tsbench.core.errors import InputError
from tsbench.metrics.aggregate import PlannerSummary
from tsbench.metrics.breakdown import STRICT
from tsbench.metrics.scd_records import PARTS
from tsbench.report.analyses.analysis import ALL, Analysis, Cell, Column, Row, Table, Value
from tsbench.report.analyses.columns import INTERVAL_NOTE, NAMES, SCD_NOTE, count_columns, panels_of, pick, text_columns
from tsbench.report.analyses.failures import CAUSE_NOTES, CAUSES, causes_of
from tsbench.report.analyses.run_pool import RunPool, check_contract, make_pool
from tsbench.report.tables.compare_runs import SELECTION, differing
from tsbench.report.tables.forest import put_title
from tsbench.run.log.read import StoredRun, read_run

# Okabe and Ito's colours.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#303030")


def perception(paths: Sequence[Path], allow_partial: bool) -> Analysis:
    """Runs of the same selection, each of one level; those of a level are put together.

    Raises InputError: one level only, different contracts or selections, two levels of one name, a planner twice at a
    level, holes without `allow_partial`.
    """
    runs = sorted((read_run(path) for path in paths), key=_rank)
    for run in runs[1:]:
        check_contract(runs[0], run)
        if differing(runs[0], run, SELECTION):
            raise InputError(f"{runs[0].path} and {run.path} have different scenarios: give runs of one selection")
    pools = {
        level: make_pool(list(some), allow_partial) for level, some in groupby(runs, lambda run: run.perception.name)
    }
    if len(pools) < 2:
        raise InputError(f"all runs are of level {next(iter(pools))}: tsbench run --perception makes others")
    return _analysis(pools)


def _rank(run: StoredRun) -> tuple[float, str]:
    """Exact first, then by the share that is read right, the best first."""
    level = run.perception.level
    return (-2.0, "") if level is None else (-level.right, level.name)


def _analysis(pools: dict[str, RunPool]) -> Analysis:
    names = tuple(dict.fromkeys(name for pool in pools.values() for name in pool.planners))
    first = next(iter(pools.values()))
    columns = (
        *text_columns("planner", "level"),
        *(Column(part, f"{NAMES[part]}\n%") for part in PARTS),
        *count_columns("n", "places", failed="signed halves\nfailed"),
        *count_columns(*CAUSES),
    )
    rows = tuple(row for name in names for row in _rows(pools, name))
    missing = sum(sum(pool.holes.values()) for pool in pools.values())
    title = f"PARTIAL, {missing} episodes missing: " if missing else ""
    effective = first.runs[0].manifest["effective"]
    title += f"SCD over perception levels: {effective['split']} split, variants {effective['variants']}"
    notes = (f"{SCD_NOTE}. Below each figure its {INTERVAL_NOTE}; strict", *CAUSE_NOTES)
    draw = partial(_draw, pools, names, title)
    return Analysis("perception", title, first.contract, Table(columns, rows, 2), notes, draw)


def _rows(pools: dict[str, RunPool], name: str) -> Iterator[Row]:
    starts = True
    for level, pool in pools.items():
        summary = _summary(pool, name)
        if summary is None:
            continue
        found = [pick(panels_of(summary, part).get(ALL), STRICT) for part in PARTS]
        main = next((e for e in found if e is not None), None)
        causes = causes_of(pool, name)
        counts: list[Cell] = [None if causes is None else causes.count(cause) for cause in CAUSES]
        cells: list[Cell] = [Value.of(e) for e in found]
        cells += [main.n, main.clusters] if main else [0, 0]
        yield Row((pool.label(name), level, *cells, len(pool.failed_signed(name)), *counts), starts=starts)
        starts = False


def _summary(pool: RunPool, name: str) -> PlannerSummary | None:
    return next((p for p in pool.summaries if p.planner == name), None)


def _draw(pools: dict[str, RunPool], names: Sequence[str], title: str) -> Figure:
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    axes = figure.subplots()
    part = next(p for p in PARTS if any(p in s.scores for pool in pools.values() for s in pool.summaries))
    for k, name in enumerate(names):
        points = []
        for at, pool in enumerate(pools.values()):
            summary = _summary(pool, name)
            figure_ = None if summary is None else pick(panels_of(summary, part).get(ALL), STRICT)
            if figure_ is not None and figure_.value is not None:
                # Side by side, so that no interval hides another.
                points.append((at + 0.06 * (k - (len(names) - 1) / 2), figure_.value, figure_.low, figure_.high))
        colour = _COLOURS[k % len(_COLOURS)]
        label = next(iter(pools.values())).label(name)
        axes.plot([p[0] for p in points], [p[1] for p in points], "o-", color=colour, label=label, ms=4, lw=1.2)
        for x, _, low, high in points:
            if low is not None and high is not None:
                axes.plot([x, x], [low, high], color=colour, lw=1.0, alpha=0.7)
    axes.set_xticks(range(len(pools)), list(pools))
    axes.set(ylim=(-3.0, 103.0), ylabel=f"{NAMES[part]}, %", xlabel="perception level")
    axes.grid(axis="y", color="#e4e4e4", linewidth=0.6)
    for text in axes.legend(fontsize=8, frameon=False).get_texts():
        text.set(parse_math=False)
    put_title(figure, title, next(iter(pools.values())).contract)
    return figure
