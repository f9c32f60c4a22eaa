"""A comparison in the terminal, and its flipped scenarios as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import asdict, fields
from pathlib import Path

from rich.console import Console
from rich.text import Text

from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.metrics.compare import Comparison, Flip
from tsbench.metrics.records import METRICS
from tsbench.report.analyses.differences import difference_columns, difference_rows
from tsbench.report.analyses.model import Analysis, Column, Kind, Table
from tsbench.report.analyses.shown import print_analysis
from tsbench.report.tables.compare import Matched

_KEY = (
    "SCD: sign-compliant and arrived, %. B-A with its 95 % interval (paired cluster bootstrap over maps). p: exact "
    "McNemar; of types after Holm over the {m} types compared, of all else as it is; metrics that are not yes/no go by "
    "their interval. *: significant (5 %). MDE: what is not significant would have been found with 80 % power from "
    "this difference on (types: at Holm's strictest step); – there: no difference could have been.",
    "Strict: an error outcome counts as a failure. Completed: pairs without an error outcome.",
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


def comparison_analyses(matched: Matched) -> tuple[Analysis, Analysis]:
    """SCD by type and group, and the metrics."""
    c, (a, b) = matched.comparison, matched.contracts
    rows = list(difference_rows(("all", f"mean of {len(c.types)}"), c.overall))
    for group, figure in c.groups.items():
        inside = [kind for kind, g in c.type_groups.items() if g == group]
        rows += difference_rows((group, f"mean of {len(inside)}"), figure, starts=True)
        for kind in inside:
            rows += difference_rows((None, kind), c.types[kind])
    names = Column("group", "group", Kind.TEXT), Column("type", "type", Kind.TEXT)
    scd = Table((*names, *difference_columns("SCD A", "SCD B", "B-A")), tuple(rows), 3)
    editions = [
        f"edition {side.run.edition}, contract {side.run.contract}" for side in (matched.a, matched.b)
    ]
    others = (f"A {editions[0]}", f"B {editions[1]}") if a != b else ()
    notes = (*(f"note: {line}" for line in matched.notes), *others)
    names = Column("metric", "metric", Kind.TEXT), Column("unit", "unit", Kind.TEXT)
    rows = [row for name, f in c.metrics.items() for row in difference_rows((name, METRICS[name].unit), f)]
    metrics = Table((*names, *difference_columns("A", "B", "B-A", 2)), tuple(rows), 3)
    key = (_KEY[0].format(m=len(c.types)), _KEY[1], *_no_interval(c))
    return (
        Analysis("scd", matched.title, a if a == b else "", scd, notes),
        Analysis("metrics", "Metrics", "", metrics, key),
    )


def flips_csv(comparison: Comparison, path: Path) -> None:
    """One line per flipped scenario."""
    text = io.StringIO()
    names = [field.name for field in fields(Flip) if field.name != "won"]
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["change", *names])
    for flip in comparison.flips:
        row = asdict(flip)
        writer.writerow(["won" if flip.won else "lost", *(row[name] for name in names)])
    with io_errors_as_input_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, text.getvalue().encode())


def _no_interval(c: Comparison) -> Iterator[str]:
    """Why some differences have none, once for each reason."""
    named = {"overall": c.overall, **c.groups, **c.types, **c.metrics}
    reasons: dict[str, list[str]] = {}
    for name, figure in named.items():
        if figure.main.low is None:
            reasons.setdefault(figure.main.reason, []).append(name)
    for reason, names in reasons.items():
        yield f"no interval ({reason}): {', '.join(names)}"


def _print_flips(flips: list[Flip], won: bool, console: Console, most: int) -> None:
    head = (
        f"won (B has SCD, A has not): {len(flips)}" if won else f"lost (A had SCD, B has not): {len(flips)}"
    )
    console.print(Text(head, style="bold"))
    for flip in flips[:most]:
        console.print(Text(f"  {flip.scenario_id}  A {_story(flip, 'a')}, B {_story(flip, 'b')}"))
    if len(flips) > most:
        console.print(Text(f"  and {len(flips) - most} more: --flips N lists more, --csv FILE writes all"))


def _story(flip: Flip, side: str) -> str:
    """Outcome, and the first broken clause of the target rule."""
    row = asdict(flip)
    clause, error = row[f"clause_{side}"], row[f"error_{side}"]
    words = [row[f"outcome_{side}"], f"broke {clause}" if clause else "", f"({error})" if error else ""]
    return " ".join(word for word in words if word)
