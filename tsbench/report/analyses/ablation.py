"""The sign-channel ablation: the same planner on the same scenes, with and without `--mask-signs`.

Source: docs/analyses.md; one variant of each test map gives 580 pairs.
Differences as in `tsbench compare`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from tsbench.core.errors import InputError
from tsbench.metrics.episode_metrics import METRICS
from tsbench.metrics.paired_differences import Comparison, compare, shared_scenarios
from tsbench.metrics.scd_records import PARTS
from tsbench.report.analyses.analysis import ALL, Analysis, Column, Kind, Row, Table, Value
from tsbench.report.analyses.columns import NAMES, READINGS_NOTE, SCD_NOTE, count_columns, number_columns, text_columns
from tsbench.report.analyses.run_pool import RunPool, check_contract, make_pool
from tsbench.report.tables.charts import INK, PALE
from tsbench.report.tables.forest import ForestRow, Mark, colour_of, difference_mark, forest_panels, lost_won, put_title
from tsbench.run.log.read import read_run

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
    return _analysis(plain, masked, found)


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


def _analysis(plain: RunPool, masked: RunPool, found: Mapping[str, Comparison]) -> Analysis:
    columns = (
        *text_columns("planner", "metric", "figure"),
        *count_columns("n"),
        *number_columns(with_signs="with\nsigns", masked="masked"),
        Column("difference", "masked\n- with"),
        Column("p", "p", Kind.P),
        *number_columns(mde="MDE"),
        *count_columns("lost", "gained", "places"),
    )
    rows = tuple(row for name, c in found.items() for row in _rows(plain.label(name), c))
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
    draw = partial(_draw, {plain.label(name): c for name, c in found.items()}, title, plain.contract)
    return Analysis("ablation", title, plain.contract, table, notes, draw)


def _rows(planner: str, c: Comparison) -> Iterator[Row]:
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


def _draw(found: Mapping[str, Comparison], title: str, contract: str) -> Figure:
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
    put_title(drawing, title, contract)
    return drawing
