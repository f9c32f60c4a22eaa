"""What commands print: tables, analyses, bars."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import click
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn
from rich.table import Table

from tsbench.core.streams import progress_console
from tsbench.core.text import written_out
from tsbench.report.analyses.analysis import Analysis, print_analysis, write_analysis
from tsbench.run.listener import LINE_EVERY_S

_LOG_WIDTH = 160


def table_console() -> Console:
    """Standard output; without a terminal there is no width to keep to: a log shall have the whole table."""
    fixed = sys.stdout.isatty() or "COLUMNS" in os.environ
    return Console(width=None if fixed else _LOG_WIDTH)


def print_table(
    heads: Sequence[str], rows: Iterable[Sequence[str]], *, title: str | None = None, left: int = 1
) -> None:
    """Cells below heads; the first `left` columns begin, the others end at one edge."""
    table = Table(box=None, header_style="bold", title=title, title_justify="left", pad_edge=False)
    for k, head in enumerate(heads):
        table.add_column(head, justify="left" if k < left else "right", no_wrap=not k, overflow="fold")
    for row in rows:
        table.add_row(*row)
    table_console().print(table)


@contextmanager
def bars() -> Iterator[Callable[[str, int, int], None]]:
    """Bars on a terminal, one for each name that the function it gives is called with: (name, done, total).

    Elsewhere a line now and then.
    """
    console = progress_console()
    if not console.is_terminal:
        yield _Lines(console)
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as progress:
        tasks: dict[str, TaskID] = {}

        def show(name: str, done: int, total: int) -> None:
            if name not in tasks:
                tasks[name] = progress.add_task(name, total=total)
            progress.update(tasks[name], completed=done, total=total)

        yield show


class _Lines:
    """What bars show, as lines: every LINE_EVERY_S seconds at most, and the end of what such a line was about."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._said = time.monotonic()
        self._told: set[str] = set()

    def __call__(self, name: str, done: int, total: int) -> None:
        now = time.monotonic()
        if now - self._said < LINE_EVERY_S and not (done == total and name in self._told):
            return
        self._said = now
        (self._told.discard if done == total else self._told.add)(name)
        self._console.print(f"{name}: {done:,} of {total:,}", markup=False, highlight=False, soft_wrap=True)


def print_notes(notes: Iterable[str]) -> None:
    """Lines on standard error about what was not taken as it is; what they quote may come from anywhere."""
    for note in notes:
        click.echo(f"note: {written_out(' '.join(note.split()))}", err=True)


def show_analysis(analysis: Analysis, out: Path | None, *, printed: bool = True) -> None:
    """Print an analysis, write its files below a folder and name them."""
    if printed:
        print_analysis(analysis, table_console())
    for path in write_analysis(analysis, out) if out is not None else ():
        click.echo(str(path))
