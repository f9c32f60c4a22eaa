"""`tsbench run` and `tsbench rescore`."""

from __future__ import annotations

import sys
from pathlib import Path

import click
from rich.console import Console

from tsbench.cli import EXIT_INTERRUPTED
from tsbench.cli.console import table_console
from tsbench.cli.options import words_of
from tsbench.planners.common.batching import DEVICES
from tsbench.run.execution.base import Limits
from tsbench.run.execution.factory import EXECUTORS
from tsbench.run.plan import TRACES, VARIANTS, Request
from tsbench.run.progress import ProgressWatcher
from tsbench.run.session import Options, RunResult
from tsbench.run.session import run as run_session
from tsbench.scenarios.table import SPLITS

EXIT_ERRORS = 1


@click.command()
@click.option(
    "--planner",
    "planners",
    multiple=True,
    required=True,
    metavar="NAME|pkg.module:Class|file.py:Class",
    help="Planner to run; give it several times for several planners.",
)
@click.option("--split", type=click.Choice(SPLITS), required=True, help="Scenario table to run.")
@click.option("--types", metavar="TYPE,GROUP,…", default="", help="Scenario types or groups; default: all.")
@click.option(
    "--limit",
    type=click.IntRange(min=1),
    metavar="N",
    help="Scenarios for each planner: types in turn, nominal ones first; of one per map, by lot.",
)
@click.option(
    "--variants",
    type=click.Choice(VARIANTS),
    default="all",
    show_default=True,
    help="The nominal variant, all, or one drawn for each map.",
)
@click.option("--workers", type=click.IntRange(min=1), metavar="N", help="Processes; default: one per core.")
@click.option(
    "--memory-limit",
    type=click.IntRange(min=512),
    default=int(Limits.most_memory),
    show_default=True,
    metavar="MB",
    help="Most that a worker, with all that its planner has started, may take in an episode.",
)
@click.option(
    "--executor",
    type=click.Choice(EXECUTORS),
    default="local",
    show_default=True,
    help="Where: on this machine, or on the Ray cluster that RAY_ADDRESS names.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Run folder; one with part of the same run is continued. Default: below runs/.",
)
@click.option(
    "--trace",
    type=click.Choice(TRACES),
    default="violations",
    show_default=True,
    help="Episodes to keep tick by tick: none, those with a violation or without success, all.",
)
@click.option(
    "--device", type=click.Choice(DEVICES), default="cpu", show_default=True, help="For learned planners."
)
@click.option("--mask-signs", is_flag=True, help="Remove sign identity from what planners see.")
@click.option(
    "--allow-partial", is_flag=True, help="Print the table of an interrupted run too, titled as partial."
)
def run(
    planners: tuple[str, ...], split: str, types: str, limit: int | None, variants: str, workers: int | None,
    memory_limit: int, executor: str, out: Path | None, trace: str, device: str, mask_signs: bool, allow_partial: bool,
) -> None:  # fmt: skip
    """Run planners on scenarios and score them; the same command again continues an interrupted run.

    Exit codes: 0 complete, 1 with error outcomes or holes, 2 wrong usage or bad input, 130 interrupted.
    """
    options = Options(
        request=Request(planners, split, words_of(types), limit, variants),
        workers=workers, executor=executor, out=out, trace=trace, device=device, mask_signs=mask_signs,
        allow_partial=allow_partial, limits=Limits(most_memory=float(memory_limit)),
    )  # fmt: skip
    ending = run_session(options, ProgressWatcher(Console(stderr=True)))
    _tell(ending, table_console())
    if ending.status == "interrupted":
        sys.exit(EXIT_INTERRUPTED)
    if ending.errors or ending.finished < ending.asked:
        sys.exit(EXIT_ERRORS)


@click.command()
@click.argument("folder", metavar="RUN", type=click.Path(path_type=Path))
def rescore(folder: Path) -> None:
    """Judge RUN's traces again, compute all its figures again, and compare with what stands in it.

    Exit code 1 and a list of episodes where they differ. RUN/rescored.json says so to reports.
    """
    from tsbench.run.log.rescored import write_rescored
    from tsbench.tools.rescore import rescore as rescore_run  # brings SUMO's readers and statistics

    result = rescore_run(folder)
    if result.note:
        click.echo(f"note: {result.note}", err=True)
    for line in result.disagreements:
        click.echo(line)
    click.echo(
        f"{folder}: {result.traces} traces judged again, {result.untraced} episodes without a trace, "
        f"disagreements: {len(result.disagreements)}"
    )
    write_rescored(folder, result.contract, result.traces, result.untraced, len(result.disagreements))
    if result.disagreements:
        sys.exit(EXIT_ERRORS)


def _tell(ending: RunResult, console: Console) -> None:
    """The table, and where everything is."""
    if ending.summary is not None:
        # They bring statistics, late as the summary itself.
        from tsbench.core.files import io_errors_as_input_errors, write_atomic
        from tsbench.report.analyses.markdown import to_markdown
        from tsbench.report.analyses.run_tables import run_tables
        from tsbench.report.analyses.shown import print_analysis
        from tsbench.run.log.folder import TABLES_TEXT

        tables = run_tables(ending.summary)
        for table in tables:
            print_analysis(table, console)
        path, text = ending.folder / TABLES_TEXT, "\n".join(to_markdown(table) for table in tables)
        # Looking at a complete run changes nothing in its folder.
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            with io_errors_as_input_errors(path):
                write_atomic(path, text.encode())
    lines = [f"{ending.finished} of {ending.asked} episodes finished, {ending.errors} with an error outcome"]
    if ending.finished < ending.asked:
        lines.append(
            "run the same command again to continue (--allow-partial prints the table of what is there)"
        )
    lines.append(f"records   {ending.folder / 'episodes.parquet'}")
    if ending.summary is not None:
        lines.append(f"tables    {ending.folder / 'summary.md'}")
    lines.append(f"traces    {ending.folder / 'traces'}")
    lines.append(f"pictures  tsbench render {ending.folder} EPISODE")
    if ending.errors:
        lines.append(f"errors    {ending.folder / 'errors'}")
    for line in lines:
        console.print(line, markup=False, highlight=False, soft_wrap=True)
