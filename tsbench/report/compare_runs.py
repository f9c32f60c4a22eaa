"""`tsbench compare`: two sides of stored runs, matched scenario by scenario or refused, and shown as tables."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.text import Text

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.core.paths import OWN_CITY, data_file
from tsbench.core.text import csv_text, did_you_mean
from tsbench.episode.perception_level import EXACTLY
from tsbench.metrics.aggregate import name_holes
from tsbench.metrics.breakdown import Scores
from tsbench.metrics.episode_metrics import METRICS
from tsbench.metrics.paired_differences import Comparison, Difference, Flip, compare, shared_scenarios
from tsbench.metrics.scd import NAMES, SCD_NOTE
from tsbench.report.analyses.analysis import ALL, Analysis, Column, Kind, Row, Table, Value, print_analysis
from tsbench.report.analyses.columns import READINGS_NOTE, difference_columns, difference_rows
from tsbench.run.log.manifest import NAME, city_of, marks_of, plain_perception, planners_of
from tsbench.run.log.read import StoredRun, is_run, read_run
from tsbench.run.options import BOTH

# What of a run's options chooses its scenarios, what else may explain a difference, and versions that contracts have.
SELECTION = ("split", "types", "variants", "half", "limit", "scenarios")
_VERSIONS = ("sumo", "numpy", "shapely")
_EXPLAINS = (*plain_perception(EXACTLY), "device")


@dataclass(frozen=True)
class Side:
    """A planner of a run. kept: of the results that come with tsbench, named by the planner alone."""

    run: StoredRun
    planner: str
    kept: bool = False

    @property
    def label(self) -> str:
        mark = marks_of(self.run.manifest).get(self.planner)
        where = "kept results" if self.kept else self.run.path
        return f"{self.planner} ({where}{f', {mark}' if mark else ''})"


@dataclass(frozen=True)
class Matched:
    """A comparison with what must be said beside it.

    warnings: why the figures are not plain ones, part of the title; notes: other things in which the runs differ.
    """

    a: Side
    b: Side
    comparison: Comparison
    warnings: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def title(self) -> str:
        text = f"A {self.a.label}, B {self.b.label}: {self.comparison.scenarios} paired scenarios"
        return ": ".join(("; ".join(self.warnings), text)) if self.warnings else text


def compare_runs(text_a: str, text_b: str, *, force: bool, allow_partial: bool) -> Matched:
    """Compare `RUN[:planner]` with `RUN[:planner]`; a planner's name alone stands for its kept results.

    Raises InputError: unreadable runs, an unclear planner; without `allow_partial` holes; without `force` different
    contracts, perception levels or scenarios.
    """
    a = find_side(text_a)
    b = find_side(text_b, a.run)
    if not force:
        _check_kept(a, b)
        _check_kept(b, a)
    return match(a, b, force=force, allow_partial=allow_partial)


def match(a: Side, b: Side, *, force: bool, allow_partial: bool) -> Matched:
    """Compare two sides, and refuse, as `compare_runs`."""
    warnings = [*_contracts(a.run, b.run, force), *_levels(a.run, b.run, force)]
    holes = {side.label: side.run.holes(side.planner) for side in (a, b)}
    asked = {side.label: side.run.asked[side.planner] for side in (a, b)}
    named = name_holes(holes, asked, allow_partial)
    partial = [f"PARTIAL, scenarios without a record ({named})"] if named else []
    left, right = a.run.of(a.planner), b.run.of(b.planner)
    first, second = shared_scenarios(left, right)
    warnings += _selections(a, b, len(left), len(right), len(first), force, bool(partial))
    if not len(first):
        raise InputError(f"{a.label} and {b.label} have no scenario in common: nothing to compare")
    comparison = compare(first, second, seed="\n".join(sorted({a.run.contract, b.run.contract})))
    notes = tuple(f"{key}: A {x}, B {y}" for key, (x, y) in differing(a.run, b.run, _EXPLAINS).items())
    return Matched(a, b, comparison, (*partial, *warnings), notes)


def find_side(text: str, beside: StoredRun | None = None) -> Side:
    """`RUN` of a run with one planner, `RUN:planner`, or a planner with kept results.

    `RUN` and `planner` may hold colons: the first run found counts. beside: what kept results are compared with.
    """
    places = [(text, None), *((text[:k], text[k + 1 :]) for k, c in enumerate(text) if c == ":" and k)]
    for path, planner in places:
        if is_run(Path(path)):
            return side_of(read_run(Path(path)), planner)
    kept = [read_run(path.parent) for path in sorted(data_file("results").glob(f"*/{NAME}"))]
    if runs := [run for run in kept if text in run.asked]:
        return Side(max(runs, key=lambda run: _likeness(run, beside)), text, kept=True)
    there = sorted({name for run in kept for name in run.asked})
    results = f"; planners with kept results{did_you_mean(text, there)}: {', '.join(there)}" if there else ""
    raise InputError(f"{text}: no run folder (expected RUN or RUN:planner, with RUN/run.json){results}")


def _likeness(run: StoredRun, beside: StoredRun | None) -> tuple[bool, bool, bool, bool, int]:
    """How well a kept run goes with another: its city, eyes and scenarios; else, and with none, by test and by size."""
    city, eyes = (OWN_CITY, EXACTLY) if beside is None else (city_of(beside.manifest), beside.perception)
    same = beside is not None and not differing(run, beside, SELECTION)
    of_run = run.manifest["effective"]
    plain = city_of(run.manifest) == city, run.perception == eyes
    return *plain, same, of_run["split"] == "test", of_run["scenarios"]


def _check_kept(kept: Side, own: Side) -> None:
    """Raises InputError, with the command that drives them, where kept results are of other scenarios."""
    if own.kept or not kept.kept or not differing(kept.run, own.run, (*SELECTION, "city")):
        return
    asked = kept.run.manifest["asked"]
    (spec,) = (info.spec for info in planners_of(own.run.manifest) if info.name == own.planner)
    given = {
        "planner": spec,
        "city": kept.run.manifest["effective"].get("city"),
        **{name: asked.get(name) for name in ("split", "variants", "limit", "perception")},
        "types": ",".join(asked["types"]),
        "half": None if asked["half"] == BOTH else asked["half"],
    }
    words = [word for name, value in given.items() if value for word in (f"--{name}", str(value))]
    command = shlex.join(["tsbench", "run", *words, *(["--mask-signs"] if kept.run.perception.masked else [])])
    raise InputError(
        f"{own.label} has other scenarios than the kept results of {kept.planner}: drive the same ones with "
        f"{command} (--force compares what both have)"
    )


def side_of(run: StoredRun, planner: str | None) -> Side:
    """A planner of a run; None: the only one. Raises InputError."""
    names = ", ".join(run.asked)
    if planner is None:
        if len(run.asked) != 1:
            raise InputError(f"{run.path}: has planners {names}: name one, as {run.path}:{next(iter(run.asked))}")
        return Side(run, next(iter(run.asked)))
    if planner not in run.asked:
        raise InputError(f"{run.path}: has no planner {planner!r}, only {names}")
    return Side(run, planner)


def _contracts(a: StoredRun, b: StoredRun, force: bool) -> list[str]:
    if a.contract == b.contract:
        return []
    if not force:
        x, y = (run.manifest.get("versions") or {} for run in (a, b))
        other = ", ".join(f"{name} {x.get(name)} and {y.get(name)}" for name in _VERSIONS if x.get(name) != y.get(name))
        raise InputError(
            f"{a.path} has contract {a.contract}, {b.path} has {b.contract}: rules, scenes or versions differ"
            f"{f' ({other})' if other else ''}, so their scores are not comparable; --force compares them all the same "
            "and says so"
        )
    return [f"FORCED, contracts differ (A {a.contract[:12]}, B {b.contract[:12]})"]


def _levels(a: StoredRun, b: StoredRun, force: bool) -> list[str]:
    """What eyes a run was driven with belongs to what it is, as its contract does."""
    if a.perception.level == b.perception.level:
        return []
    x, y = a.perception.name, b.perception.name
    if not force:
        raise InputError(
            f"{a.path} is of perception {x}, {b.path} of {y}: tsbench analyse perception shows levels side by side; "
            "--force compares them all the same and says so"
        )
    return [f"FORCED, perception levels differ (A {x}, B {y})"]


def _selections(a: Side, b: Side, n_a: int, n_b: int, common: int, force: bool, partial: bool) -> list[str]:
    """Holes may explain different scenarios, but only of runs that were asked for the same ones."""
    if n_a == n_b == common:
        return []
    if partial and not differing(a.run, b.run, SELECTION) and a.run.contract == b.run.contract:
        return []
    counts = f"A has {n_a}, B has {n_b}, {common} in common"
    if not force:
        raise InputError(f"the runs have different scenarios ({counts}): --force compares the common ones and says so")
    return [f"FORCED, different scenarios ({counts})"]


def differing(a: StoredRun, b: StoredRun, keys: Sequence[str]) -> dict[str, tuple[Any, Any]]:
    """Options in which two runs differ, with both values."""
    both = {key: tuple(run.manifest["effective"].get(key) for run in (a, b)) for key in keys}
    return {key: (x, y) for key, (x, y) in both.items() if x != y}


_KEY = (
    f"{SCD_NOTE}. B-A with its 95 % interval (over places) over n pairs (paired SCD) or "
    "scenes. p: exact McNemar; of types after Holm over those compared, of all else as it is; metrics that are not "
    "yes/no go by their interval. *: significant (5 %). MDE: what is not significant would have been found with "
    "80 % power from this difference on (types: at Holm's strictest step); – there: no difference could have been",
    READINGS_NOTE,
)


def print_comparison(matched: Matched, console: Console, most_flips: int) -> None:
    """Print what changed. most_flips: how many of the won and of the lost scenarios are listed."""
    for analysis in comparison_analyses(matched):
        print_analysis(analysis, console)
    for won in (False, True):
        flips = [flip for flip in matched.comparison.flips if flip.won == won]
        _print_flips(flips, won, console, most_flips)
    for name, side in (("A", matched.a), ("B", matched.b)):
        console.print(Text(f"{name} {side.run.rescored}", style="dim"), soft_wrap=True)


def standing(found: Sequence[Matched]) -> Analysis:
    """The sides of comparisons with one A on one screen: the primary figure of each, over all types and by group."""
    panels = list(dict.fromkeys(name for m in found for name in _primary(m)[1]))
    distinct = len({m.b.planner for m in found}) == len(found)
    rows: dict[Row, None] = {}
    for m in found:
        a, b = (side.planner if distinct else side.label for side in (m.a, m.b))
        part, figures = _primary(m)
        one = [figures.get(name, Difference()) for name in panels]
        rows[Row((f"A {a}", *(d.a for d in one)))] = None
        rows[Row((f"B {b}", *(d.b for d in one)), starts=True)] = None
        rows[Row((f"B-A, {NAMES[part]}", *(Value.difference(d) for d in one)))] = None
    names = Column("planner", "%", Kind.TEXT), *(Column(name, name, signed=True) for name in panels)
    warned = dict.fromkeys(warning for m in found for warning in m.warnings)
    return Analysis("standing", "; ".join([*warned, "Where they stand"]), "", Table(names, tuple(rows), 1), ())


def _primary(matched: Matched) -> tuple[str, dict[str, Difference]]:
    """The first figure of SCD that the records have: its name, and by panel."""
    part, scores = next(iter(matched.comparison.scores.items()))
    return part, {name: figure.main for name, figure in scores.panels(ALL).items()}


def comparison_analyses(matched: Matched) -> tuple[Analysis, ...]:
    """A table for each figure of SCD, the primary one first, and one of the other metrics."""
    c, a, b = matched.comparison, matched.a.run.contract, matched.b.run.contract
    editions = [f"edition {side.run.edition}, contract {side.run.contract}" for side in (matched.a, matched.b)]
    others = (f"A {editions[0]}", f"B {editions[1]}") if a != b else ()
    notes = (*(f"note: {line}" for line in matched.notes), *others)
    first, *rest = (_scores(NAMES[part], scores) for part, scores in c.scores.items())
    contract = a if a == b else ""
    tables = [Analysis("scd", matched.title, contract, first, notes, data=matched.a.run.data)]
    names = Column("metric", "metric", Kind.TEXT), Column("unit", "unit", Kind.TEXT)
    rows = [row for name, f in c.metrics.items() for row in difference_rows((name, METRICS[name].unit), f)]
    metrics = Table((*names, *difference_columns("A", "B", "B-A", 2)), tuple(rows), 3)
    titles = [NAMES[part][0].upper() + NAMES[part][1:] for part in c.scores][1:]
    tables += [Analysis("scd", title, "", table, ()) for title, table in zip(titles, rest, strict=True)]
    return (*tables, Analysis("metrics", "Metrics", "", metrics, (*_KEY, *_no_interval(c))))


def _scores(name: str, scores: Scores[Difference]) -> Table:
    rows = list(difference_rows(("all", f"mean of {len(scores.types)}"), scores.overall))
    for group, figure in scores.groups.items():
        inside = [kind for kind, g in scores.type_groups.items() if g == group]
        rows += difference_rows((group, f"mean of {len(inside)}"), figure, starts=True)
        for kind in inside:
            rows += difference_rows((None, kind), scores.types[kind])
    names = Column("group", "group", Kind.TEXT), Column("type", "type", Kind.TEXT)
    return Table((*names, *difference_columns(f"{name}\nA", f"{name}\nB", "B-A")), tuple(rows), 3)


def flips_csv(comparison: Comparison, path: Path) -> None:
    names = [field.name for field in fields(Flip) if field.name != "won"]
    rows = [["won" if flip.won else "lost", *(getattr(flip, name) for name in names)] for flip in comparison.flips]
    with io_errors_as_input_errors(path):
        write_atomic(path, csv_text([["change", *names], *rows]).encode())


def _no_interval(c: Comparison) -> Iterator[str]:
    """Why some differences have none, once for each reason."""
    named = {
        f"{NAMES[part]} {name}": figure
        for part, scores in c.scores.items()
        for name, figure in {**scores.panels("overall"), **scores.types}.items()
    }
    named |= c.metrics
    reasons: dict[str, list[str]] = {}
    for name, figure in named.items():
        if figure.main.low is None:
            reasons.setdefault(figure.main.reason, []).append(name)
    for reason, names in reasons.items():
        yield f"no interval ({reason}): {', '.join(names)}"


def _print_flips(flips: list[Flip], won: bool, console: Console, most: int) -> None:
    head = f"won (B has SCD, A has not): {len(flips)}" if won else f"lost (A had SCD, B has not): {len(flips)}"
    console.print(Text(head, style="bold"))
    for flip in flips[:most]:
        console.print(Text(f"  {flip.scenario_id}  A {_story(flip, 'a')}, B {_story(flip, 'b')}"))
    if len(flips) > most:
        console.print(Text(f"  and {len(flips) - most} more: --flips N lists more, --csv FILE writes all"))


def _story(flip: Flip, side: str) -> str:
    row = asdict(flip)
    clause, error = row[f"clause_{side}"], row[f"error_{side}"]
    words = [row[f"outcome_{side}"], f"broke {clause}" if clause else "", f"({error})" if error else ""]
    return " ".join(word for word in words if word)
