"""`tsbench export`: episodes of a run for other projects' tools."""

from __future__ import annotations

from pathlib import Path

import click

from tsbench.cli.selecting import check_choice, make_and_tell, selection_options
from tsbench.report.export.episodes import FORMATS, export_episode, export_selection
from tsbench.report.selection import Selection


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.argument("episode", metavar="[EPISODE]", required=False)
@click.option("--format", "kind", type=click.Choice(FORMATS), required=True, help="CommonRoad XML or MCAP.")
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="PATH",
    help="File, or folder for a selection; default: below RUN/exports/.",
)  # fmt: skip
@selection_options
def export(
    run: Path, episode: str | None, kind: str, out: Path | None, selection: Selection, workers: int
) -> None:
    """Write EPISODE (scenario_id or planner/scenario_id) of the run folder RUN, or a selection, in another format.

    A selection is written in parallel; what is already there is kept.
    """
    check_choice(run, episode, selection)
    if episode is not None:
        click.echo(str(export_episode(run, episode, kind, out)))
        return
    make_and_tell(
        lambda progress: export_selection(run, selection, kind, out, workers, progress), f"{kind} files"
    )
    click.echo(f"below {run / 'exports' if out is None else out}")
