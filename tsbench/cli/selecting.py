"""What `tsbench render` and `tsbench export` share: choosing episodes of a run, and telling what came of them."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from tsbench.cli.options import several, words_of
from tsbench.core.errors import InputError
from tsbench.core.machine import own_cores
from tsbench.report.episode_files import FileKind, make_one, make_selected
from tsbench.report.video.selection import Selection, episode_name

_FAILURES_SHOWN = 20
_OPTIONS = (
    click.option("--violations", is_flag=True, help="All episodes in which the target sign was violated."),
    click.option(
        "--types", metavar="TYPE,GROUP,…", default="", help="All of these scenario types or groups."
    ),
    click.option("--planner", "planners", multiple=True, metavar="NAME", help="All of this planner."),
    click.option("--outcome", "outcomes", multiple=True, metavar="OUTCOME", help="All that ended like this."),
    click.option(
        "--workers", type=click.IntRange(min=1), metavar="N", help="Processes; default: one per core."
    ),
)


def selection_options(command: Callable[..., None]) -> Callable[..., None]:
    """Options that select many episodes; the command gets them as `selection` and `workers`."""

    @functools.wraps(command)
    def called(
        violations: bool, types: str, planners: tuple[str, ...], outcomes: tuple[str, ...], workers: int | None,
        **others: Any,
    ) -> None:  # fmt: skip
        selection = Selection(violations, words_of(types), planners, outcomes)
        command(selection=selection, workers=workers or own_cores(), **others)

    return several(*_OPTIONS)(called)


def make_and_tell(
    run: Path, episode: str | None, selection: Selection, kind: FileKind, out: Path | None, workers: int
) -> None:
    """Make the file of one episode or those of a selection, and print what came of it.

    Shows a bar; exit code 1 where some could not be made. Raises InputError where neither or both are given.
    """
    if (episode is None) != bool(selection):
        raise InputError(
            f"{run}: name one EPISODE, or select some with --violations, --types, --planner or --outcome"
        )
    if episode is not None:
        click.echo(str(make_one(run, episode, kind, out)))
        return
    what = f"{kind.suffix.rpartition('.')[2]} files"
    console = Console(stderr=True)
    with Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(),
        console=console, disable=not console.is_terminal,
    ) as bar:  # fmt: skip
        task = bar.add_task(what, total=None)
        tally, chosen = make_selected(
            run,
            selection,
            kind,
            out,
            workers,
            lambda done, total: bar.update(task, completed=done, total=total),
        )
    if chosen.untraced:
        click.echo(f"{chosen.untraced} selected episodes have no trace (tsbench run --trace all keeps them)")
    for trace, problem in tally.failed[:_FAILURES_SHOWN]:
        click.echo(f"{episode_name(trace)}: {problem}")
    line = f"{tally.made} {what} made, {tally.kept} kept, {len(tally.failed)} failed"
    if tally.made:
        line += (
            f"; {tally.driven_s:.0f} s of driving in {tally.wall_s:.1f} s and {tally.cpu_s:.1f} s of CPU time:"
            f" {tally.driven_s / tally.cpu_s:.0f} times faster than real time on a core"
        )
    click.echo(line)
    click.echo(f"below {run / kind.folder if out is None else out}")
    if tally.failed:
        sys.exit(1)
