"""A comparison in the terminal, and its flipped scenarios as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator
from dataclasses import asdict, fields
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from tsbench.metrics.compare import Comparison, Flip, PairedFigure
from tsbench.metrics.paired import Difference
from tsbench.metrics.records import METRICS
from tsbench.report.compare import Matched
from tsbench.run.files import told_plainly, write_atomic

_DASH = "–"
_KEY = (
    "SCD: sign-compliant and arrived, %. B-A with its 95 % interval (paired cluster bootstrap over maps). p: exact "
    "McNemar; of types after Holm over the {m} types compared, of all else as it is; metrics that are not yes/no go by "
    "their interval. *: significant (5 %). MDE: what is not significant would have been found with 80 % power from "
    "this difference on (types: at Holm's strictest step); – there: no difference could have been.",
    "Strict: an error outcome counts as a failure. A second line (completed): pairs without an error outcome.",
)


def print_comparison(matched: Matched, console: Console, most_flips: int) -> None:
    """Print what changed. most_flips: how many of the won and of the lost scenarios are listed."""
    c = matched.comparison
    console.print(Text(matched.title, style="bold yellow" if matched.warnings else "bold"))
    for line in matched.notes:
        console.print(Text(f"note: {line}", style="yellow"))
    console.print(_scd_table(c))
    console.print(_metric_table(c))
    for line in (_KEY[0].format(m=len(c.types)), _KEY[1], *_no_interval(c)):
        console.print(Text(line, style="dim"))
    for won in (False, True):
        _print_flips([flip for flip in c.flips if flip.won == won], won, console, most_flips)
    a, b = (f"edition {side.run.edition}, contract {side.run.contract}" for side in (matched.a, matched.b))
    for line in (a,) if a == b else (f"A {a}", f"B {b}"):
        console.print(Text(line, style="dim"), soft_wrap=True)
    for name, side in (("A", matched.a), ("B", matched.b)):
        console.print(Text(f"{name} {side.run.rescored}", style="dim"), soft_wrap=True)


def flips_csv(comparison: Comparison, path: Path) -> None:
    """One line per flipped scenario."""
    text = io.StringIO()
    names = [field.name for field in fields(Flip) if field.name != "won"]
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["change", *names])
    for flip in comparison.flips:
        row = asdict(flip)
        writer.writerow(["won" if flip.won else "lost", *(row[name] for name in names)])
    with told_plainly(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, text.getvalue().encode())


def _scd_table(c: Comparison) -> Table:
    table = _table("group", "type")
    for column in ("SCD A", "SCD B", "B-A", "p", "MDE", "lost", "won", "pairs"):
        table.add_column(column, justify="right", no_wrap=True)

    def add(group: str, kind: str, figure: PairedFigure) -> None:
        for style, d in _lines(figure):
            name = (group, kind) if style is None else ("", "  completed")
            table.add_row(*name, *_cells(d, lambda v: f"{v:.1f}"), *_counts(d), style=style)

    add("all", f"mean of {len(c.types)}", c.overall)
    for group, figure in c.groups.items():
        table.add_section()
        inside = [kind for kind, g in c.type_groups.items() if g == group]
        add(group, f"mean of {len(inside)}", figure)
        for kind in inside:
            add("", kind, c.types[kind])
    return table


def _metric_table(c: Comparison) -> Table:
    table = _table("metric", "unit")
    for column in ("A", "B", "B-A", "p", "MDE", "only A", "only B", "pairs"):
        table.add_column(column, justify="right", no_wrap=True)
    for name, figure in c.metrics.items():
        for style, d in _lines(figure):
            shown = (name if style is None else "  completed", METRICS[name].unit)
            table.add_row(*shown, *_cells(d, lambda v: f"{v:.2f}"), *_counts(d), style=style)
    return table


def _table(*heads: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 2, 0, 0))
    for head in heads:
        table.add_column(head, no_wrap=True)
    return table


def _lines(figure: PairedFigure) -> Iterator[tuple[str | None, Difference]]:
    yield None, figure.main
    if figure.strict is not None and figure.strict.n != figure.completed.n:
        yield "dim", figure.completed


def _cells(d: Difference, number: Callable[[float], str]) -> list[str]:
    def shown(value: float | None) -> str:
        return _DASH if value is None else number(value)

    if d.value is None:
        return [_DASH] * 5
    ends = "–" if d.low is None or d.high is None else f"{number(d.low)} to {number(d.high)}"
    star = "*" if d.significant else " "
    mde = "" if d.significant else shown(d.mde)
    return [shown(d.a), shown(d.b), f"{_signed(number, d.value)} ({ends}){star}", _probability(d), mde]


def _signed(number: Callable[[float], str], value: float) -> str:
    text = number(value)
    return text if text.startswith("-") else f"+{text}"


def _probability(d: Difference) -> str:
    p = d.p if d.p_holm is None else d.p_holm
    if p is None:
        return ""
    return "<0.001" if p < 0.001 else f"{p:.3f}"


def _counts(d: Difference) -> list[str]:
    return ["" if k is None else str(k) for k in (d.lost, d.won)] + [str(d.n)]


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
