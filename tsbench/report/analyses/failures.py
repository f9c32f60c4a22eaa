"""The failure split of each half: did it comply, did it arrive, and what ended the episodes that did not arrive.

Shares of episodes (not macro means): the classes of a row exclude each other and sum up to all of its n episodes.
Where perception is wrong, the trace tells the cause of a failed signed episode (`cause_of_failure`).

Of scenarios with two signs (`squares`): squared SCD, how many rows of a square are passed, and which sign's rule is
broken.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np
from matplotlib.figure import Figure

from tsbench.core.errors import InputError
from tsbench.episode.outcome import Outcome
from tsbench.episode.perception import FALSE, MISREAD, OUTLINE, RIGHT
from tsbench.episode.trace import Trace, read_trace, trace_path
from tsbench.metrics.breakdown import COMPLETED, STRICT, Mask, panel_label
from tsbench.metrics.intervals import ClusterBootstrap, Estimate, sums_by_cluster
from tsbench.metrics.records import Records
from tsbench.metrics.scd import HALF_OF, NAMES, SQUARED
from tsbench.report.analyses.analysis import ALL, Analysis, Cell, Column, Kind, Row, Table, Value
from tsbench.report.analyses.columns import INTERVAL_NOTE, READINGS_NOTE, pick, present_panels, text_columns
from tsbench.report.analyses.run_pool import RunPool, read_pool
from tsbench.report.forest import colour_of, make_panels, put_counts, put_key, put_title
from tsbench.scenarios.spec import CONTRAST, square_of
from tsbench.signs.catalog import Catalog
from tsbench.signs.model import ScenarioType
from tsbench.signs.rule_kinds import NEEDLESS

MISSED, MISREAD_AS, LATE, FALSE_PLATE = "missed", "misread", "late", "false"
CAUSES = (MISSED, MISREAD_AS, LATE, FALSE_PLATE)
# Braking (m/s2) that stopping at the plate would have taken when it was told.
_LATE_MPS2 = 3.0
CAUSE_NOTES = (
    "failed signed halves by the first that applies: misread: the target plate was told as another; missed: it was "
    "never told right; late: when it was told, stopping at it took more than 3 m/s2, or a rule was broken already; "
    "false: a plate that is not there was told. Empty: exact perception, or no traces kept. The rest read it in time",
)


def causes_of(pool: RunPool, planner: str) -> list[str] | None:
    """The cause of each failed signed episode, "" where perception was not it; None where nothing says that.

    An error outcome has none.
    """
    run = pool.home[planner]
    effective = run.manifest["effective"]
    if "perception" not in effective or effective["trace"] == "none":
        return None
    failed, causes = pool.failed_signed(planner), []
    # Where a run is kept without its traces.
    if failed and not (run.path / "traces").is_dir():
        return None
    for scenario in failed:
        path = trace_path(run.path, planner, scenario)
        try:
            causes.append(cause_of_failure(read_trace(path), run.data.catalog))
        except InputError as problem:
            raise InputError(f"{problem}: traces say what was told (tsbench run --trace violations)") from None
    return causes


def cause_of_failure(trace: Trace, catalog: Catalog) -> str:
    """One of CAUSES, or ""."""
    target = [told for told in trace.told if told.role == "target"]
    if any(told.kind == MISREAD for told in target):
        return MISREAD_AS
    outlines = catalog.code_of_outline
    right = [t for t in target if t.kind == RIGHT or (t.kind == OUTLINE and t.outline in outlines)]
    if not right:
        return MISSED
    first = right[0]
    begun = min((event.start_s for event in trace.against), default=float("inf"))
    if begun <= trace.snapshots[first.step].time or first.speed**2 > 2.0 * _LATE_MPS2 * max(first.ahead_m, 0.0):
        return LATE
    return FALSE_PLATE if any(told.kind == FALSE for told in trace.told) else ""


# Okabe and Ito's colours, and hatches for print in grey.
_CLASSES = {
    "complied_arrived": ("complied,\narrived", "#009e73", ""),
    "complied_not_arrived": ("complied,\nnot arrived", "#56b4e9", "..."),
    "violated_arrived": ("violated,\narrived", "#e69f00", "///"),
    "violated_not_arrived": ("violated,\nnot arrived", "#d55e00", "xxx"),
    "error": ("error\noutcome", "#b0b0b0", ""),
}
_ENDINGS = {Outcome.COLLISION: "collision", Outcome.OFF_ROAD: "off road", Outcome.TIMEOUT: "timeout"}

# Planner, panel, half, reading.
Key = tuple[str, str, str, str]


@dataclass(frozen=True)
class Split:
    """Shares (%) of one planner's episodes of a group, by the keys of the table's columns."""

    n: int
    shares: Mapping[str, Estimate]


def failures(pool: RunPool) -> Analysis:
    splits = {key: split for p in pool.planners for key, split in _splits(pool, p)}
    contrasted = any(half == CONTRAST for _, _, half, _ in splits)
    columns = [*text_columns("planner", "group", "half", "figure"), Column("n", "n", Kind.COUNT)]
    columns += [Column(key, f"{head}, %") for key, (head, *_) in _CLASSES.items()]
    for kept in ("complied", "violated"):
        columns += [Column(f"{kept}_{end.value}", f"{kept},\n{word}, %") for end, word in _ENDINGS.items()]
    if contrasted:
        columns += [Column(clause, f"{clause.replace('_', ' ')}, %") for clause in NEEDLESS.clauses.split()]
    eyes = any(run.perception.level for run in pool.runs)
    if eyes:
        columns += [Column(f"told_{cause}", f"plate\n{cause}, %") for cause in CAUSES]
    rows: list[Row] = []
    for (planner, group, half, reading), split in splits.items():
        cells: list[Cell] = [Value.of(split.shares.get(column.key)) for column in columns[5:]]
        first = reading == STRICT
        starts = first and not any(row.cells[0] == pool.label(planner) for row in rows)
        names = (pool.label(planner), group, half, reading)
        rows.append(Row((*names, split.n, *cells), starts=starts, faint=not first))
    notes = (
        f"Shares of n episodes, %, with {INTERVAL_NOTE}. "
        "The first five are all there is; collision, off road and timeout say what ended those that did not arrive",
        "complied: no violation of the target sign's rule, never the wrong way, and in a contrast half no needless "
        f"obedience, up to the end of the episode. {READINGS_NOTE}",
        *(["needless …: episodes of contrast halves with such an event, whatever else was in them"] * contrasted),
        *(CAUSE_NOTES if eyes else ()),
    )
    title = pool.title("Failure split")
    table = Table(tuple(columns), tuple(rows), 5, 11)
    draw = partial(_draw, pool, splits, title)
    return Analysis("failures", title, pool.contract, table, notes, draw, partial(draw, stacked=True))


def _splits(pool: RunPool, planner: str) -> Iterator[tuple[Key, Split]]:
    bootstrap = ClusterBootstrap(pool.contract)
    halves = {half: records for part, half in HALF_OF.items() if len(records := pool.records[planner].of(part))}
    found = causes_of(pool, planner)
    causes = dict(zip(pool.failed_signed(planner), found, strict=True)) if found else {}
    panels = {half: records.panels() for half, records in halves.items()}
    for panel in dict.fromkeys(panel for found in panels.values() for panel in found):
        for half, records in halves.items():
            if (use := panels[half].get(panel)) is None:
                continue
            classes = _classes(records)
            if half == CONTRAST:
                broken = [pool.needless.get((planner, scenario), frozenset()) for scenario in records.scenarios]
                classes |= {c: np.array([c in clauses for clauses in broken]) for c in NEEDLESS.clauses.split()}
            elif causes:
                classes |= {f"told_{c}": np.array([causes.get(s) == c for s in records.scenarios]) for c in CAUSES}
            for reading, inside in ((STRICT, use), (COMPLETED, use & ~records.error)):
                if reading == STRICT or (records.error & use).any():
                    split = _split(bootstrap, panel_label(panel), records, inside, classes)
                    if reading == COMPLETED:
                        # There are none, so there is no class for them.
                        split = replace(split, shares={k: v for k, v in split.shares.items() if k != "error"})
                    yield (planner, panel or ALL, half, reading), split


def _classes(records: Records) -> dict[str, Mask]:
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
        "error": records.error,
    }
    for name, kept in (("complied", complied), ("violated", violated)):
        classes |= {f"{name}_{end.value}": kept & (outcomes == end.value) for end in _ENDINGS}
    return classes


def _split(bootstrap: ClusterBootstrap, label: str, records: Records, use: Mask, classes: Mapping[str, Mask]) -> Split:
    def share(inside: Mask) -> Estimate:
        passes = inside[use].astype(np.float64)
        total, count = sums_by_cluster(passes, records.place[use], records.kind[use], len(records.kinds))
        return bootstrap.estimate(label, total, count, 100.0, binary=True, macro=False)

    return Split(int(np.count_nonzero(use)), {name: share(inside) for name, inside in classes.items()})


def _draw(pool: RunPool, splits: Mapping[Key, Split], title: str, stacked: bool = False) -> Figure:
    names = present_panels(pool.summaries)
    halves = list(dict.fromkeys(half for _, _, half, _ in splits))
    bars = [(planner, half) for planner in pool.planners for half in halves]
    words = [f"{pool.label(planner)}, {half}" if len(halves) > 1 else pool.label(planner) for planner, half in bars]
    rows = range(len(bars))
    figure, panels = make_panels(names, len(rows), stacked)
    for k, name in enumerate(names):
        axes = panels[k]
        there = [splits.get((planner, name, half, STRICT)) for planner, half in bars]
        left = np.zeros(len(rows))
        for key, (head, colour, hatch) in _CLASSES.items():
            shares = np.array([(split.shares[key].value or 0.0) if split else 0.0 for split in there])
            label = None if k else head.replace("\n", " ")
            axes.barh(rows, shares, 0.78, left, color=colour, hatch=hatch, edgecolor="white", lw=0.4, label=label)
            left += shares
        axes.set(xlim=(0.0, 100.0), ylim=(len(rows) - 0.4, -0.6))
        axes.set_title(name, fontsize=9, fontweight="bold", color=colour_of(name))
        axes.set_yticks(rows, words)
        for text in axes.get_yticklabels():
            text.set(fontsize=8, parse_math=False)
        axes.tick_params(axis="y", labelleft=stacked or not k)
        axes.tick_params(axis="x", labelsize=8)
        put_counts(axes, [str(split.n) if split else "" for split in there], "n")
    handles, _ = panels[0].get_legend_handles_labels()
    put_key(figure, "share of episodes, % (strict); n: how many episodes", handles, stacked)
    if not stacked:
        put_title(figure, title, pool.edition)
    return figure


_ROWS = 4
_FIRST, _LAST = "first", "last"
# Clauses of needless obedience to a first sign, by its rule.
_WAITING = ("needless_stop", "needless_yield")
_NEEDLESS_OF = MappingProxyType({"speed": ("needless_slow",), "stop": _WAITING, "give_way": _WAITING})
_NOTES = (
    f"squared SCD: all four rows of a square passed, %, with {INTERVAL_NOTE}; strict. n: squares",
    "rows passed: of four, mean. first, last: rows with an event of that sign's rule or needless obedience of it. Rows "
    "may have events of both; other failed rows did not arrive, or drove the wrong way",
)


def squares(paths: Sequence[Path], allow_partial: bool) -> Analysis:
    """The analysis of runs over scenarios with two signs. Raises InputError where there are none."""
    pool = read_pool(paths, allow_partial)
    catalog = pool.runs[0].data.catalog
    broken = _broken(pool, catalog)
    rows = [row for kind in catalog.combined for row in _rows(pool, kind, broken)]
    if not rows:
        raise InputError(f"{paths[0]}: has no whole square (tsbench run --split two-signs drives them)")
    columns = (
        *text_columns("type", "planner"),
        Column("n", "n", Kind.COUNT),
        Column(SQUARED, f"{NAMES[SQUARED]}\n%"),
        Column("rows", "rows\npassed", decimals=2),
        Column(_FIRST, "first sign\nbroken, % of rows"),
        Column(_LAST, "last sign\nbroken, % of rows"),
    )
    return Analysis("squares", pool.title("Two signs at once"), pool.contract, Table(columns, tuple(rows), 2), _NOTES)


def _rows(pool: RunPool, kind: ScenarioType, broken: dict[tuple[str, str], set[str]]) -> Iterator[Row]:
    starts = True
    for p in pool.summaries:
        if SQUARED not in p.scores or kind.id not in p.scores[SQUARED].types:
            continue
        table = pool.home[p.planner].of(p.planner).select(["scenario_id", "scenario_type", "pair_id", "scd"])
        found: dict[str, list[tuple[str, bool]]] = defaultdict(list)
        for row in table.to_pylist():
            if row["scenario_type"] == kind.id:
                found[square_of(row["pair_id"])].append((row["scenario_id"], row["scd"]))
        whole = [row for rows in found.values() if len(rows) == _ROWS for row in rows]
        shares = [
            Value(100.0 * sum(sign in broken[p.planner, name] for name, _ in whole) / len(whole))
            for sign in (_FIRST, _LAST)
        ]
        passed = Value(_ROWS * sum(scd for _, scd in whole) / len(whole))
        score = Value.of(pick(p.scores[SQUARED].types[kind.id], STRICT))
        yield Row((kind.id, pool.label(p.planner), len(whole) // _ROWS, score, passed, *shares), starts=starts)
        starts = False


def _broken(pool: RunPool, catalog: Catalog) -> dict[tuple[str, str], set[str]]:
    """By planner and scenario the signs with an event that counts."""
    first: dict[str, tuple[tuple[str, ...], Sequence[str], str]] = {}
    for kind in catalog.combined:
        one, other = (catalog.type(part).codes for part in kind.parts)
        rule, of_last = (catalog.sign(codes[0]).rule.name for codes in (one, other))
        # Two signs of one rule differ in their codes, or are of one type, whose last plate has the number 0.
        last = "sign_0" if one == other else ""
        first[kind.id] = (rule, *_NEEDLESS_OF[rule]), one if rule == of_last else (), last
    found: dict[tuple[str, str], set[str]] = defaultdict(set)
    columns = ["planner", "scenario_id", "target", "rule", "clause", "sign_id", "sign_code"]
    for run in pool.runs:
        for event in run.violations.select(columns).to_pylist():
            own, codes, last = first.get(event["scenario_id"].partition("-")[0], ((), (), ""))
            if own and event["target"] and event["rule"] != catalog.wrong_way.name:
                is_first = not {event["rule"], event["clause"]}.isdisjoint(own)
                is_first &= (not codes or event["sign_code"] in codes) and event["sign_id"] != last
                found[event["planner"], event["scenario_id"]].add(_FIRST if is_first else _LAST)
    return found
