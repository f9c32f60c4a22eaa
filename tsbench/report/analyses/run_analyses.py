"""The analyses of runs by their names. Those with a picture bring matplotlib, so they are imported when asked for.

Here: SCD of every planner in tables, the main table with conventional metrics, by type, and above the floor.
Published figures stand below a planner's own. Source of the floor: docs/contrast.md, "What is reported".
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from tsbench.core.errors import load
from tsbench.episode.outcome import Outcome
from tsbench.metrics.aggregate import PlannerSummary, Summary
from tsbench.metrics.breakdown import COMPLETED, STRICT, StrictAndCompleted
from tsbench.metrics.episode_metrics import METRICS
from tsbench.metrics.intervals import Estimate
from tsbench.metrics.scd import NAMES, SCD_NOTE, SIGNED_ONES
from tsbench.report.analyses.analysis import ALL, DASH, Analysis, Cell, Column, Kind, Row, Table, Value
from tsbench.report.analyses.columns import (
    INTERVAL_NOTE,
    NOTE,
    READINGS_NOTE,
    is_whole,
    panels_of,
    pick,
    present_panels,
    present_parts,
    present_types,
    published_metric,
    readings,
    scd_beside,
    scd_columns,
    text_columns,
    with_rings,
)
from tsbench.report.analyses.run_pool import RunPool, read_pool
from tsbench.run.log.manifest import city_of, read_manifest
from tsbench.scenarios.data_set import DataSet

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def per_type(planners: Sequence[PlannerSummary], title: str, contract: str, edition: str) -> Analysis:
    """Rows for each type: a figure of SCD in each, and once more completed only, where errors make a difference."""
    rows: list[Row] = []
    parts, last = present_parts(planners), ""
    for kind, group in present_types(planners):
        # Where there are several figures each type is a block, otherwise each group is.
        block = kind if len(parts) > 1 else group
        for part in parts:
            figures = [_figure(p, part, kind) for p in planners]
            if not any(figures):
                continue
            differ = any(figure and figure.differ for figure in figures)
            for reading in (STRICT, COMPLETED) if differ else (STRICT,):
                starts, last = block != last, block
                cells = _cells(planners, figures, kind, reading)
                rows.append(Row((group, kind, NAMES[part], reading, *cells), starts=starts, faint=reading != STRICT))
    columns = [*text_columns("group", "type", "score", "figure")]
    for p in planners:
        columns += [Column(p.planner, f"{p.label}\n%"), Column(f"{p.planner}_count", "n", Kind.COUNT)]
    columns.append(Column("places", "places", Kind.TEXT))
    notes = (
        f"{SCD_NOTE}. n: pairs, halves. Below each figure its {INTERVAL_NOTE}",
        f"{READINGS_NOTE}, where that differs",
    )
    table = Table(tuple(columns), tuple(rows), 4, 12)
    return Analysis("types", title, contract, table, notes, partial(_draw, planners, title, edition))


def _figure(p: PlannerSummary, part: str, kind: str) -> StrictAndCompleted[Estimate] | None:
    return p.scores[part].types.get(kind) if part in p.scores else None


def _cells(
    planners: Sequence[PlannerSummary], figures: Sequence[StrictAndCompleted[Estimate] | None], kind: str, reading: str
) -> list[Cell]:
    """Each planner's figure with its n, and how many places they rest on (of partial runs from least to most)."""
    estimates = [pick(figure, reading) for figure in figures]
    cells = [cell for e in estimates for cell in (Value.of(e), None if e is None else e.n)]
    counts = [e.clusters for e in estimates if e is not None]
    placed = all(p.placed for p in planners)
    told = DASH.join(str(n) for n in dict.fromkeys((min(counts), max(counts))))
    return [*cells, with_rings(told, kind, placed)]


def _draw(planners: Sequence[PlannerSummary], title: str, edition: str) -> Figure:
    from matplotlib.figure import Figure  # a run ends with this table, and needs no picture of it

    from tsbench.report.forest import put_counts, put_title

    primary = present_parts(planners)[0]
    kinds = present_types(planners, primary)
    figure = Figure(figsize=(3.6 + 0.62 * max(len(planners), 6), 1.9 + 0.27 * len(kinds)), layout="constrained")
    axes = figure.subplots()
    found = {
        (y, x): e.value
        for y, (kind, _) in enumerate(kinds)
        for x, p in enumerate(planners)
        if (e := pick(_figure(p, primary, kind), STRICT)) is not None and e.value is not None
    }
    shade = [[found.get((y, x), float("nan")) for x in range(len(planners))] for y in range(len(kinds))]
    image = axes.imshow(shade, cmap="cividis", vmin=0.0, vmax=100.0, aspect="auto")
    for (y, x), value in found.items():
        colour = "black" if value > 50.0 else "white"
        axes.text(x, y, f"{value:.0f}", ha="center", va="center", fontsize=7, color=colour)
    axes.set_xticks(range(len(planners)), [p.label for p in planners], rotation=45, ha="right")
    counts = [sorted({e.n for p in planners if (e := pick(_figure(p, primary, kind), STRICT))}) for kind, _ in kinds]
    axes.set_yticks(range(len(kinds)), [f"{kind} ({group})" for kind, group in kinds])
    for label in (*axes.get_xticklabels(), *axes.get_yticklabels()):
        label.set(fontsize=8, parse_math=False)
    put_counts(axes, [f"n {DASH.join(str(n) for n in dict.fromkeys((c[0], c[-1])))}" for c in counts])
    axes.tick_params(length=0)
    bar = figure.colorbar(image, ax=axes, pad=0.02, aspect=40)
    bar.set_label(f"{NAMES[primary]}, % of n for each planner (strict)", fontsize=8)
    bar.ax.tick_params(labelsize=8)
    put_title(figure, title, edition)
    return figure


PUBLISHED = "published"
_METRICS = {name: metric for name, metric in METRICS.items() if metric.head}


def main_table(planners: Sequence[PlannerSummary], title: str, contract: str, beside: str = "") -> Analysis:
    """One row for each reading of each planner: strict, completed where it differs, published.

    beside: the contract, where the study's figures may stand beside those of its planners.
    """
    first, *others = present_parts(planners)
    # The primary figure by group too, the others beside it.
    shown = [*((first, panel) for panel in present_panels(planners)), *((part, ALL) for part in others)]
    columns = (
        *text_columns("planner", "figure"),
        Column("n", "n", Kind.COUNT),
        *(_column(part, panel) for part, panel in shown),
        *(Column(name, f"{metric.head}\n{metric.unit}") for name, metric in _METRICS.items()),
    )
    rows = tuple(row for p in planners for row in _rows(p, shown, beside))
    notes = (
        f"{SCD_NOTE}; other metrics are means over episodes. Below each figure its {INTERVAL_NOTE}",
        f"{READINGS_NOTE}. n: episodes; what fewer or pairs count for has its own n in the CSV",
        *(f"{p.label}: {line}" for p in planners for line in _warnings(p)),
        *([NOTE] if any(row.cells[1] == PUBLISHED for row in rows) else []),
    )
    return Analysis("main", title, contract, Table(columns, rows, 3), notes)


def _column(part: str, panel: str) -> Column:
    key, head = ("overall", "all") if panel == ALL else (panel, panel)
    return Column(f"{part}_{key}", f"{NAMES[part]}\n{head}")


def _warnings(p: PlannerSummary) -> Iterator[str]:
    bad = {kind: n for kind, n in p.outcomes.items() if n and Outcome(kind).is_error}
    if bad:
        named = ", ".join(f"{n} {kind}" for kind, n in bad.items())
        yield f"{p.recorded - p.completed} error outcomes ({named}), causes in errors/"
    fewer = {name: n for name in _METRICS if (n := p.metrics[name].completed.n) < p.completed}
    if fewer:
        named = ", ".join(f"{name} could be computed for {n}" for name, n in fewer.items())
        yield f"{named} of {p.completed} completed episodes"
    for part, scores in p.scores.items():
        if scores.overall.main.value is not None and scores.overall.main.low is None:
            yield f"no interval for the overall {NAMES[part]}: {scores.overall.main.reason}"


def _rows(p: PlannerSummary, shown: Sequence[tuple[str, str]], beside: str) -> Iterator[Row]:
    for reading in readings(p):
        figures = [pick(panels_of(p, part).get(panel), reading) for part, panel in shown]
        figures += [pick(p.metrics[name], reading) for name in _METRICS]
        cells: list[Cell] = [Value.of(figure) for figure in figures]
        first = reading == STRICT
        n = p.recorded if first else p.completed
        yield Row((p.label, reading, n, *cells), starts=first, faint=not first)
    # What the reference published is over signed scenes.
    told = [scd_beside(p, panel, beside) if part == SIGNED_ONES else None for part, panel in shown]
    whole = is_whole(p, ALL, beside)
    told += [published_metric(p.planner, name) if whole else None for name in _METRICS]
    if any(number is not None for number in told):
        cells = [None if number is None else Value(number) for number in told]
        yield Row((p.label, PUBLISHED, None, *cells), faint=True)


def run_tables(summary: Summary) -> tuple[Analysis, ...]:
    return (
        main_table(summary.planners, summary.title, summary.contract_hash),
        per_type(summary.planners, f"{summary.title}: SCD by type", summary.contract_hash, summary.edition),
    )


def floor(pool: RunPool) -> Analysis:
    """A block of rows for all types, each group and each type; in it the planners, those that are floors last."""
    planners = sorted(pool.summaries, key=lambda p: p.floor)
    parts = present_parts(planners)
    rows: list[Row] = []
    for panel in present_panels(planners):
        rows += _block(planners, parts, "all" if panel == ALL else "group", panel)
    for kind, _ in present_types(planners):
        rows += _block(planners, parts, "type", kind)
    floors = ", ".join(p.planner for p in planners if p.floor)
    notes = (*_FLOOR_NOTES, f"floor: {floors} read no plate" if floors else "none of the planners is a floor")
    title = pool.title("Planners and the sign-blind floor")
    columns = (*text_columns("over", "types", "planner"), *scd_columns(parts), *_COUNTED)
    return Analysis("floor", title, pool.contract, Table(columns, tuple(rows), 3), notes)


_COUNTED = (Column("n", "n", Kind.COUNT), Column("places", "places", Kind.TEXT))
_FLOOR_NOTES = (
    f"{SCD_NOTE}. Below each figure its {INTERVAL_NOTE}",
    "strict: error outcomes count as failures. n: squares, pairs, or halves where there are none; places: theirs",
)


def campaign_table(name: str, runs: Mapping[str, Summary]) -> Analysis:
    """A block of rows for each run of a campaign, by its name; in it the planners, those that are floors last."""
    parts = present_parts(p for summary in runs.values() for p in summary.planners)
    rows: list[Row] = []
    for run, summary in runs.items():
        planners = sorted(summary.planners, key=lambda p: p.floor)
        rows += [replace(row, cells=(run, *row.cells[2:])) for row in _block(planners, parts, "all", ALL)]
    contracts = list(dict.fromkeys(summary.contract_hash for summary in runs.values()))
    several = [
        f"contract {contract}: {', '.join(run for run, s in runs.items() if s.contract_hash == contract)}"
        for contract in contracts
        if len(contracts) > 1
    ]
    partial = "PARTIAL: " if any(summary.partial for summary in runs.values()) else ""
    table = Table((*text_columns("run", "planner"), *scd_columns(parts), *_COUNTED), tuple(rows), 2)
    contract = "" if several else contracts[0]
    return Analysis("campaign", f"{partial}Campaign {name}", contract, table, (*_FLOOR_NOTES, *several))


def _block(planners: list[PlannerSummary], parts: Sequence[str], over: str, name: str) -> Iterator[Row]:
    for k, p in enumerate(planners):
        figures = [_figure(p, part, name) if over == "type" else panels_of(p, part).get(name) for part in parts]
        found = [pick(figure, STRICT) for figure in figures]
        main = next((e for e in found if e is not None), None)
        cells: list[Cell] = [Value.of(e) for e in found]
        if main is not None:
            places = with_rings(str(main.clusters), name, p.placed)
            yield Row((over, name, p.label, *cells, main.n, places), starts=not k, faint=p.floor)


def _later(module: str, name: str) -> Callable[..., Analysis]:
    """An analysis whose module is imported when it is asked for."""
    return lambda *given: getattr(load(f"tsbench.report.analyses.{module}"), name)(*given)


OF_POOL: Mapping[str, Callable[[RunPool], Analysis]] = {
    "main": lambda pool: main_table(pool.summaries, pool.title("Main table"), pool.contract, pool.contract),
    "types": lambda pool: per_type(pool.summaries, pool.title("SCD by type"), pool.contract, pool.edition),
    "intervals": _later("scd_statistics", "intervals"),
    "failures": _later("failures", "failures"),
    "correlations": _later("scd_statistics", "correlations"),
    "floor": floor,
}
_OF_RUNS = {
    "ablation": _later("paired_runs", "ablation"),
    "perception": _later("paired_runs", "perception"),
    "squares": _later("failures", "squares"),
}


def analyse_runs(name: str, paths: Sequence[Path], allow_partial: bool) -> Analysis:
    """The analysis `name` of stored runs. Raises InputError for runs that cannot be analysed together."""
    made = _OF_RUNS[name](paths, allow_partial) if name in _OF_RUNS else OF_POOL[name](read_pool(paths, allow_partial))
    manifest = read_manifest(paths[0])
    assert manifest is not None, "it has been analysed"
    return replace(made, data=DataSet.named(city_of(manifest)))
