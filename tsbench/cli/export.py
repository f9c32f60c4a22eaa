"""`tsbench export`: episodes of a run for other projects' tools."""

from __future__ import annotations

from pathlib import Path

import click

from tsbench.cli.selecting import make_and_tell, selection_options
from tsbench.report.export.formats import FORMATS, export_kind
from tsbench.report.video.selection import Selection


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
    make_and_tell(run, episode, selection, export_kind(kind), out, workers)
