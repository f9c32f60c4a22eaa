"""`tsbench run` (each option is a field of `run/options.py`), `tsbench rescore`, and `tsbench campaign`.

A campaign is the runs that a file lists, with one table over them. Source: docs/run.md, "Campaigns".
"""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click
from msgspec import Meta
from rich.console import Console

from tsbench.cli import EXIT_FAILED, EXIT_INPUT, EXIT_INTERRUPTED, options
from tsbench.cli.analyse import KINDS
from tsbench.cli.config import given_options, long_name
from tsbench.cli.console import print_table, show_analysis, table_console
from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.core.streams import progress_console
from tsbench.core.text import written_out
from tsbench.core.typed import read_typed
from tsbench.episode.perception_level import EXACT
from tsbench.report.analyses.analysis import markdown_notes, to_markdown
from tsbench.report.analyses.run_analyses import analyse_runs, campaign_table, run_tables
from tsbench.report.analyses.run_pool import read_pool
from tsbench.report.run_ending import citation, examples, headline
from tsbench.run.listener import ProgressWatcher, listeners_of
from tsbench.run.log.folder import TABLES_TEXT, TRACES
from tsbench.run.log.read import StoredRun, is_run, read_run, write_rescored
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
    lines.append(f"report    tsbench report {folder}")
    if ended.errors:
        lines.append(f"errors    {ended.folder / 'errors'}")
    if stored is not None and stored.edition:
        lines.append(f"edition {stored.edition}, contract {ended.contract[:12]}")
    for line in lines:
        console.print(line, markup=False, highlight=False, soft_wrap=True)


# Options of `tsbench run` that the command line may give for all runs; they go before the file.
_FOR_ALL = ("types", "limit", "variants", "workers", "executor", "trace")
# The campaign has them itself.
_NOT_IN_FILE = ("out", "overwrite")


@dataclass(frozen=True)
class CampaignRun:
    """A run of a campaign. given: the file's values, as `Context.default_map` of `tsbench run` takes them."""

    name: str
    given: Mapping[str, Any]


@dataclass(frozen=True)
class CampaignAnalysis:
    """An analysis over runs of a campaign. kind: its command. name: of its files."""

    kind: str
    name: str
    runs: tuple[CampaignRun, ...]


@dataclass(frozen=True)
class _Analysis:
    analysis: str
    runs: Annotated[tuple[str, ...], Meta(min_length=1)]
    name: str | None = None


@dataclass(frozen=True)
class _File:
    runs: Annotated[tuple[dict[str, Any], ...], Meta(min_length=1)]
    defaults: dict[str, Any] = field(default_factory=dict)
    analyses: Annotated[tuple[_Analysis, ...], Meta(min_length=1)] = ()


def read_campaign(path: Path) -> tuple[tuple[CampaignRun, ...], tuple[CampaignAnalysis, ...]]:
    """The runs and the analyses of a file, checked. Raises InputError with the place in it."""
    file = read_typed(_File, path, "campaign")
    runs = tuple(one for n, entry in enumerate(file.runs, 1) for one in _runs(entry, file.defaults, path, n))
    names = [one.name for one in runs]
    if twice := [name for k, name in enumerate(names) if name in names[:k]]:
        raise InputError(f"{path}: runs: {twice[0]}: two runs have this name: rename one")
    for one in runs:
        options_of(one, {}, path)
    made = (_analysis(entry, runs, f"{path}: analyses {n}") for n, entry in enumerate(file.analyses, 1))
    return runs, tuple(made)


def _runs(told: Mapping[str, Any], defaults: Mapping[str, Any], path: Path, number: int) -> Iterator[CampaignRun]:
    """The run of an entry, or one for each of its levels of perception."""
    name = _name(told.get("name"), f"{path}: runs {number}")
    values = {key: value for key, value in {**defaults, **told}.items() if key != "name"}
    if own := [key for key in _NOT_IN_FILE if key in values]:
        raise InputError(f"{path}: {name}: {own[0]}: a campaign gives it itself: leave it out")
    levels = values.get("perception")
    for level in levels if isinstance(levels, list) else [None]:
        one = values if level is None else {**values, "perception": level}
        suffix = "" if level in (None, EXACT) else f"-{Path(str(level)).stem}"
        yield CampaignRun(name + suffix, given_options(run, one, f"{path}: {name}:"))


def _analysis(told: _Analysis, runs: Sequence[CampaignRun], where: str) -> CampaignAnalysis:
    if told.analysis not in KINDS:
        raise InputError(f"{where}: analysis: {told.analysis!r}: expected one of {', '.join(KINDS)}")
    chosen = _named(told.runs, runs, f"{where}: runs")
    return CampaignAnalysis(told.analysis, _name(told.analysis if told.name is None else told.name, where), chosen)


def _named(names: Sequence[Any], runs: Sequence[CampaignRun], where: str) -> tuple[CampaignRun, ...]:
    """The runs of these names, in the file's order. Raises InputError for a name that no run has."""
    known = [one.name for one in runs]
    if unknown := [name for name in names if name not in known]:
        raise InputError(f"{where}: {unknown[0]}: no such run; there are {', '.join(known)}")
    return tuple(one for one in runs if one.name in names)


def _name(value: Any, where: str) -> str:
    if not isinstance(value, str) or not re.fullmatch(r"(?!analyses$)\w[\w.+-]*", value):
        raise InputError(f"{where}: name: {value!r}: expected the name of a folder, other than 'analyses'")
    return value


def options_of(one: CampaignRun, over: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """The values of all options of `tsbench run`. Raises InputError for a wrong one."""
    context = click.Context(run, info_name=one.name, default_map={**one.given, **over})
    with context:
        try:
            run.parse_args(context, [])
        except click.BadParameter as problem:
            key = long_name(problem.param) if isinstance(problem.param, click.Option) else ""
            raise InputError(f"{path}: {one.name}: {key}: {problem.message or 'is missing'}") from None
        except InputError as problem:
            raise InputError(f"{path}: {one.name}: {problem}") from None
        return context.params


def _for_all(option: click.Parameter) -> click.Parameter:
    again = copy(option)
    again.default = None  # as in the file
    return again


@click.command(params=[_for_all(option) for option in run.params if option.name in _FOR_ALL])
@click.argument("file", metavar="FILE", type=options.FILE)
@options.out("Folder of the runs, each in a folder of its name. Default: runs/FILE.", type=options.FOLDER)
@click.option("--only", multiple=True, metavar="NAME", help="Only this run; give it several times for several runs.")
@click.option("--no-drive", is_flag=True, help="Only the table and the analyses of runs that are there.")
def campaign(file: Path, out: Path | None, only: tuple[str, ...], no_drive: bool, **others: Any) -> None:
    """Drive the runs that FILE lists; the same command again goes on where it was stopped. Print a table over all.

    FILE is YAML: `runs` is a list; each has a `name` and options of `tsbench run` by their names, of which `defaults`
    gives those of all. A list of levels of `perception` makes a run of each. `analyses`, a list of commands of
    `tsbench analyse` with their `runs`, are made when all runs are complete.

    Exit codes: as of `tsbench run`; 2 also where a run could not be driven, while the others were.
    """
    runs, analyses = read_campaign(file)
    chosen = _named(only, runs, "--only") if only else runs
    folder = Path("runs") / file.stem if out is None else out
    over = {name: value for name, value in others.items() if value not in (None, ())}
    code, summaries = (0, _stored(chosen, folder)) if no_drive else _driven(chosen, over, file, folder)
    if summaries:
        show_analysis(campaign_table(file.stem, summaries), folder / "analyses")
    for analysis in analyses:
        if missing := [one.name for one in analysis.runs if one.name not in summaries]:
            click.echo(f"analysis {analysis.name}: not made without {', '.join(missing)}")
        else:
            _make(analysis, folder)
    sys.exit(code)


def _driven(
    runs: Sequence[CampaignRun], over: Mapping[str, Any], file: Path, folder: Path
) -> tuple[int, dict[str, Summary]]:
    """Drive runs, one after the other: the exit code, and the summaries of those that are complete."""
    code, summaries = 0, {}
    for one in runs:
        try:
            ended, _ = drive(**{**options_of(one, over, file), "out": folder / one.name})
        except InputError as problem:
            click.echo(f"{one.name}: {written_out(' '.join(str(problem).split()))}", err=True)
            code = EXIT_INPUT
            continue
        click.echo(
            f"{one.name}: {ended.finished} of {ended.asked} episodes finished, {ended.errors} with an error outcome"
        )
        if ended.status == "interrupted":
            sys.exit(EXIT_INTERRUPTED)
        if ended.errors or ended.finished < ended.asked:
            code = max(code, EXIT_FAILED)
        if ended.summary is not None:
            summaries[one.name] = ended.summary
    return code, summaries


def _stored(runs: Sequence[CampaignRun], folder: Path) -> dict[str, Summary]:
    there = [one.name for one in runs if is_run(folder / one.name)]
    return {name: read_pool([folder / name], allow_partial=False).summary for name in there}


def _make(analysis: CampaignAnalysis, folder: Path) -> None:
    """Write an analysis below the `analyses` of a campaign's folder."""
    out, paths = folder / "analyses", tuple(folder / one.name for one in analysis.runs)
    # Why plates were not read in time is found in traces. Where these are gone, the analysis stays as it is.
    eyes = [one for one in analysis.runs if one.given.get("perception", EXACT) != EXACT]
    traced = all((folder / one.name / TRACES).is_dir() for one in eyes)
    if analysis.kind == "perception" and not traced and (out / f"{analysis.name}.md").is_file():
        click.echo(f"analysis {analysis.name}: stays as it is, as traces are gone")
        return
    made = analyse_runs(analysis.kind, paths, allow_partial=False)
    show_analysis(replace(made, name=analysis.name), out, printed=False)
