"""The same planner on the same scenes, seeing otherwise: the sign-channel ablation, and levels of perception.

Ablation: with and without `--mask-signs`; one variant of each test map gives 580 pairs. Source: docs/report.md.
Differences as in `tsbench compare`. Levels: what wrong perception costs each planner. Source: docs/perception.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import groupby
from pathlib import Path

from matplotlib.figure import Figure

from tsbench.core.errors import InputError
from tsbench.metrics.aggregate import PlannerSummary
from tsbench.metrics.breakdown import STRICT
from tsbench.metrics.episode_metrics import METRICS
from tsbench.metrics.paired_differences import Comparison, compare, shared_scenarios
from tsbench.metrics.scd import NAMES, PARTS, SCD_NOTE
from tsbench.report.analyses.analysis import ALL, Analysis, Cell, Column, Kind, Row, Table, Value
from tsbench.report.analyses.columns import (
    INTERVAL_NOTE,
    READINGS_NOTE,
    count_columns,
    number_columns,
    panels_of,
    pick,
    text_columns,
)
from tsbench.report.analyses.failures import CAUSE_NOTES, CAUSES, causes_of
from tsbench.report.analyses.run_pool import RunPool, check_contract, make_pool
from tsbench.report.charts import INK, PALE
from tsbench.report.compare_runs import SELECTION, differing
from tsbench.report.forest import ForestRow, Mark, colour_of, difference_mark, forest_panels, lost_won, put_title
from tsbench.run.log.read import StoredRun, read_run

_METRICS = tuple(name for name, metric in METRICS.items() if metric.head and not metric.about_rule)


def ablation(paths: Sequence[Path], allow_partial: bool) -> Analysis:
    """Pair masked runs with plain ones, planner by planner.

    The scenes are those of the masked runs; plain runs may hold more. Raises InputError: no run of one kind, different
    contracts, scenes without a partner, holes without `allow_partial`.
    """
    runs = [read_run(path) for path in paths]
    kinds = {masked: [run for run in runs if run.perception.masked == masked] for masked in (False, True)}
    if not kinds[False] or not kinds[True]:
        lacking = "with" if kinds[False] else "without"
        raise InputError(f"the ablation needs runs with and without --mask-signs: none {lacking} it was given")
    check_contract(kinds[False][0], kinds[True][0])
    plain, masked = (make_pool(kinds[side], allow_partial) for side in (False, True))
    common = [name for name in plain.planners if name in masked.planners]
    if not common:
        raise InputError(
            f"no planner is in both: without --mask-signs {', '.join(plain.planners)}; "
            f"with it {', '.join(masked.planners)}"
        )
    found = {name: _compare(plain, masked, name) for name in common}
    return _ablation(plain, masked, found)


def _compare(plain: RunPool, masked: RunPool, planner: str) -> Comparison:
    asked = masked.home[planner].of(planner)
    a, b = shared_scenarios(plain.home[planner].of(planner), asked)
    lacking = len(asked) - len(b)
    if (lacking and not plain.holes.get(planner)) or not len(b):
        raise InputError(
            f"{plain.home[planner].path}: {planner} has not driven {lacking} of the {len(asked)} scenes of "
            f"{masked.home[planner].path}: run it on the same selection"
        )
    return compare(a, b, seed=plain.contract)


def _ablation(plain: RunPool, masked: RunPool, found: Mapping[str, Comparison]) -> Analysis:
    columns = (
        *text_columns("planner", "metric", "figure"),
        *count_columns("n"),
        *number_columns(with_signs="with\nsigns", masked="masked"),
        Column("difference", "masked\n- with"),
        Column("p", "p", Kind.P),
        *number_columns(mde="MDE"),
        *count_columns("lost", "gained", "places"),
    )
    rows = tuple(row for name, c in found.items() for row in _ablation_rows(plain.label(name), c))
    scenarios = sorted({c.scenarios for c in found.values()})
    told = "–".join(str(n) for n in dict.fromkeys((scenarios[0], scenarios[-1])))
    missing = sum(sum(pool.holes.values()) for pool in (plain, masked))
    title = f"PARTIAL, {missing} episodes missing: " if missing else ""
    title += f"Sign-channel ablation: {told} paired episodes for each of {len(found)} planners, {masked.selection}"
    alone = [name for name in (*plain.planners, *masked.planners) if name not in found]
    notes = (
        f"{SCD_NOTE}; other metrics are means over episodes. Masked: plates are seen without code and value",
        "masked - with: over the same n pairs (paired SCD) or scenes, 95 % interval (over places); "
        "p: exact McNemar; MDE: what is not significant would have been found with 80 % power from this on; "
        "lost, gained: what only the run with signs, only the masked one has",
        f"{READINGS_NOTE}. By type: tsbench compare RUN:PLANNER MASKED:PLANNER",
        *([f"without a partner, left out: {', '.join(alone)}"] if alone else []),
    )
    table = Table(columns, rows, 4)
    draw = partial(_draw_ablation, {plain.label(name): c for name, c in found.items()}, title, plain.edition)
    return Analysis("ablation", title, plain.contract, table, notes, draw)


def _ablation_rows(planner: str, c: Comparison) -> Iterator[Row]:
    named = {
        f"{NAMES[part]}, {name}": figure
        for part, scores in c.scores.items()
        for name, figure in scores.panels(ALL).items()
    }
    named |= {name: c.metrics[name] for name in _METRICS}
    for k, (name, figure) in enumerate(named.items()):
        for second, (reading, d) in enumerate(figure.readings()):
            rest = (d.p, d.mde, d.lost, d.won, d.clusters)
            cells = (planner, name, reading, d.n, d.a, d.b, Value.of(d), *rest)
            yield Row(cells, starts=not k and not second, faint=bool(second))


def _draw_ablation(found: Mapping[str, Comparison], title: str, edition: str) -> Figure:
    part = next(part for part in PARTS if any(part in c.scores for c in found.values()))
    figures = {planner: c.scores[part].panels(ALL) for planner, c in found.items() if part in c.scores}
    panels: dict[str, list[ForestRow]] = {name: [] for named in figures.values() for name in named}
    for name, rows in panels.items():
        for planner in found:
            figure = figures.get(planner, {}).get(name)
            marks = () if figure is None else (difference_mark(figure, colour_of(name), mean=True),)
            rows.append(ForestRow(planner, marks, "" if figure is None else lost_won(figure)))
    key = {
        "significant (exact McNemar, 5 %)": Mark(0.0, 0.0, 0.0, INK, marker="D"),
        "not significant": Mark(0.0, 0.0, 0.0, INK, marker="D", filled=False),
        "minimum detectable effect": Mark(0.0, 0.0, 0.0, PALE, marker="|"),
    }
    unit = (
        f"{NAMES[part]} with signs masked minus that with signs, percentage points (strict), 95 % interval; "
        "right of each panel: lost/gained of n"
    )
    drawing = forest_panels(panels, unit, (-100.0, 100.0), key, "lost/gained")
    put_title(drawing, title, edition)
    return drawing


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
    return _by_level(pools)


def _rank(run: StoredRun) -> tuple[float, str]:
    """Exact first, then by the share that is read right, the best first."""
    level = run.perception.level
    return (-2.0, "") if level is None else (-level.right, level.name)


def _by_level(pools: dict[str, RunPool]) -> Analysis:
    names = tuple(dict.fromkeys(name for pool in pools.values() for name in pool.planners))
    first = next(iter(pools.values()))
    columns = (
        *text_columns("planner", "level"),
        *(Column(part, f"{NAMES[part]}\n%") for part in PARTS),
        *count_columns("n", "places", failed="signed halves\nfailed"),
        *count_columns(*CAUSES),
    )
    rows = tuple(row for name in names for row in _level_rows(pools, name))
    missing = sum(sum(pool.holes.values()) for pool in pools.values())
    title = f"PARTIAL, {missing} episodes missing: " if missing else ""
    effective = first.runs[0].manifest["effective"]
    title += f"SCD over perception levels: {effective['split']} split, variants {effective['variants']}"
    notes = (f"{SCD_NOTE}. Below each figure its {INTERVAL_NOTE}; strict", *CAUSE_NOTES)
    draw = partial(_draw_levels, pools, names, title)
    return Analysis("perception", title, first.contract, Table(columns, rows, 2), notes, draw)


def _level_rows(pools: dict[str, RunPool], name: str) -> Iterator[Row]:
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


def _draw_levels(pools: dict[str, RunPool], names: Sequence[str], title: str) -> Figure:
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
    put_title(figure, title, next(iter(pools.values())).edition)
    return figure
