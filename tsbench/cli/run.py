"""`tsbench run` (each option is a field of `run/options.py`) and `tsbench rescore`."""

from __future__ import annotations

import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console

from tsbench.cli import EXIT_FAILED, EXIT_INTERRUPTED, options
from tsbench.cli.console import print_table, table_console
from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.core.streams import progress_console
from tsbench.report.analyses.analysis import markdown_notes, to_markdown
from tsbench.report.analyses.run_analyses import run_tables
from tsbench.report.run_ending import citation, examples, headline
from tsbench.run.listener import ProgressWatcher, listeners_of
from tsbench.run.log.folder import TABLES_TEXT
from tsbench.run.log.read import StoredRun, read_run, write_rescored
from tsbench.run.options import RunOptions
from tsbench.run.session import RunResult
from tsbench.run.session import run as run_session
from tsbench.scenarios.data_set import DataSet

if TYPE_CHECKING:
    from tsbench.metrics.aggregate import Summary


@click.command()
@options.of(RunOptions)
def run(**given: Any) -> None:
    """Run planners on scenarios and score them; the same command again continues an interrupted run.

    Exit codes: 0 complete, 1 with error outcomes or holes, 2 wrong usage or bad input, 130 interrupted.
    """
    ended, stored = drive(**given)
    _tell(ended, stored, table_console())
    if ended.status == "interrupted":
        sys.exit(EXIT_INTERRUPTED)
    if ended.errors or ended.finished < ended.asked:
        sys.exit(EXIT_FAILED)


def drive(data: DataSet, **given: Any) -> tuple[RunResult, StoredRun | None]:
    """The run that the options of `tsbench run` ask for, in a data set, and what its folder holds where it has figures:
    the tables as text, too.

    Raises InputError: wrong options, bad input, or a folder that cannot be used.
    """
    asked = RunOptions(**given, city=data.name)
    ended = run_session(asked, ProgressWatcher(progress_console()), listeners_of(asked.listeners))
    stored = None if ended.summary is None else read_run(ended.folder)
    if ended.summary is not None and stored is not None:
        _write_tables(stored, ended.summary)
    return ended, stored


@click.command()
@click.argument("folder", metavar="RUN", type=options.PATH)
def rescore(folder: Path) -> None:
    """Judge RUN's traces again, compute all its figures again, and compare with what stands in it.

    Exit code 1 and a list of episodes where they differ. RUN/rescored.json says so to reports.
    """
    # It imports the rules, which the process of a run needs nowhere else.
    from tsbench.run.rescore import rescore as rescore_run

    result = rescore_run(folder)
    if result.note:
        click.echo(f"note: {result.note}", err=True)
    for line in result.disagreements:
        click.echo(line)
    click.echo(
        f"{folder}: {result.traces} traces judged again, {result.untraced} episodes without a trace, "
        f"disagreements: {len(result.disagreements)}"
    )
    write_rescored(folder, result.data, result.contract, result.traces, result.untraced, len(result.disagreements))
    if result.disagreements:
        sys.exit(EXIT_FAILED)


def _write_tables(run: StoredRun, summary: Summary) -> None:
    lines, entry = citation(run, summary.planners)
    cited = "\n".join(["**To cite**", "", *(f"* {line}" for line in lines), "", "```bibtex", entry, "```"])
    tables = run_tables(summary)
    shown = [to_markdown(replace(table, notes=(), contract="")) for table in tables]
    notes = ["\n".join([f"**Notes: {table.title}**", "", *markdown_notes(table)]) for table in tables]
    path, text = run.path / TABLES_TEXT, "\n\n".join([part.strip() for part in (*shown, cited, *notes)]) + "\n"
    # Looking at a complete run changes nothing in its folder.
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        with io_errors_as_input_errors(path):
            write_atomic(path, text.encode())


def _tell(ended: RunResult, stored: StoredRun | None, console: Console) -> None:
    if ended.summary is not None:
        heads, rows = headline(ended.summary.planners)
        print_table(heads, rows, title=ended.summary.title)
    failed = [] if stored is None else list(examples(stored))
    lines = [*failed, f"{ended.finished} of {ended.asked} episodes finished, {ended.errors} with an error outcome"]
    if ended.finished < ended.asked:
        lines.append("run the same command again to continue (--allow-partial: the table so far)")
    lines.append(f"records   {ended.folder / 'episodes.parquet'}")
    if stored is not None:
        lines.append(f"tables    {ended.folder / 'summary.md'}")
    lines.append(f"traces    {ended.folder / 'traces'}")
    folder = shlex.quote(str(ended.folder))
    if failed:
        lines.append(f"failures  tsbench failures {folder}")
    lines.append(f"pictures  tsbench render {folder} EPISODE")
    if ended.errors:
        lines.append(f"errors    {ended.folder / 'errors'}")
    if stored is not None and stored.edition:
        lines.append(f"edition {stored.edition}, contract {ended.contract[:12]}")
    for line in lines:
        console.print(line, markup=False, highlight=False, soft_wrap=True)
