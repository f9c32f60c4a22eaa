"""`tsbench render` and `tsbench export`: episodes of a run as pictures, films, or in other projects' formats."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from tsbench.cli import options
from tsbench.cli.console import bars
from tsbench.cli.options import Words
from tsbench.core.errors import InputError
from tsbench.report.episode_files import FORMATS as EXPORTS
from tsbench.report.episode_files import FileKind, Selection, export_kind, make_one, make_selected
from tsbench.report.scene_pictures import FORMATS as PICTURES
from tsbench.report.scene_pictures import picture_kind
from tsbench.signs.countries import Country

_FAILURES_SHOWN = 20


def _selecting(command: Callable[..., None]) -> Callable[..., None]:
    """Arguments and options that name an episode or select many; the command gets them as `selection` and `workers`."""

    @functools.wraps(command)
    def called(failures: bool, types: Words, planners: Words, outcomes: Words, **others: Any) -> None:
        command(selection=Selection(failures, types, planners, outcomes), **others)

    return options.several(
        click.argument("run", type=options.PATH),
        click.argument("episode", metavar="[EPISODE]", required=False),
        click.option("--failures", is_flag=True, help="All episodes without SCD: not compliant, or not arrived."),
        options.types,
        options.planners("All of this planner"),
        click.option("--outcome", "outcomes", multiple=True, metavar="OUTCOME", help="All that ended like this."),
        options.workers,
    )(called)


@click.command()
@_selecting
@click.option("--format", "kind", type=click.Choice(PICTURES), help="Default: png, or --out's suffix.")
@options.out("File, or folder for a selection; default: below RUN/pictures/.")
@click.option("--time", type=float, metavar="S", help="Moment of a PNG; default: the violation, else half-way.")
@options.caption_country
def render(
    run: Path,
    episode: str | None,
    kind: str | None,
    out: Path | None,
    time: float | None,
    selection: Selection,
    workers: int,
    country: Country | None,
) -> None:
    """Draw EPISODE (scenario_id or planner/scenario_id) of the run folder RUN, or a whole selection.

    The PNG of a failed half shows the other half beside it. An episode without a trace is driven again, and has one
    then. A selection is drawn in parallel; files that are there are kept, so the same command continues after a break.
    """
    if episode is None and time is not None:
        raise InputError("--time chooses the moment of one EPISODE; a selection is drawn at its violations")
    pictures = picture_kind(kind, out if episode else None, time, country)
    _make(run, episode, selection, pictures, out, workers)


@click.command()
@_selecting
@click.option("--format", "kind", type=click.Choice(EXPORTS), required=True, help="CommonRoad XML or MCAP.")
@options.out("File, or folder for a selection; default: below RUN/exports/.")
def export(run: Path, episode: str | None, kind: str, out: Path | None, selection: Selection, workers: int) -> None:
    """Write EPISODE (scenario_id or planner/scenario_id) of the run folder RUN, or a selection, in another format.

    An episode without a trace is driven again. A selection is written in parallel; files that are there are kept.
    """
    _make(run, episode, selection, export_kind(kind), out, workers)


def _make(run: Path, episode: str | None, selection: Selection, kind: FileKind, out: Path | None, workers: int) -> None:
    """Make the file of one episode or those of a selection, and print what came of it.

    Shows a bar; exit code 1 where some could not be made. Raises InputError where neither or both are given.
    """
    if (episode is None) != bool(selection):
        raise InputError(f"{run}: name one EPISODE, or select some with --failures, --types, --planner or --outcome")
    if episode is not None:
        click.echo(str(make_one(run, episode, kind, out)))
        return
    what = f"{kind.suffix.rpartition('.')[2]} files"
    with bars() as show:
        tally = make_selected(run, selection, kind, out, workers, functools.partial(show, what))
    for name, problem in tally.failed[:_FAILURES_SHOWN]:
        click.echo(f"{name}: {problem}")
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
