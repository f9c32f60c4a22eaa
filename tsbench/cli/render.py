"""`tsbench render`: episodes of a run as PNG, GIF or MP4."""

from __future__ import annotations

from pathlib import Path

import click

from tsbench.cli.options import jurisdiction_option
from tsbench.cli.selecting import make_and_tell, selection_options
from tsbench.core.errors import InputError
from tsbench.report.video.render import FORMATS, picture_kind
from tsbench.report.video.selection import Selection
from tsbench.signs.countries import Country


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.argument("episode", metavar="[EPISODE]", required=False)
@click.option(
    "--format", "kind", type=click.Choice(FORMATS), default=None, help="Default: png, or --out's suffix."
)
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="PATH",
    help="File, or folder for a selection; default: below RUN/pictures/.",
)  # fmt: skip
@click.option(
    "--time", type=float, metavar="S", help="Moment of a PNG; default: the violation, else half-way."
)
@selection_options
@jurisdiction_option
def render(
    run: Path, episode: str | None, kind: str | None, out: Path | None, time: float | None,
    selection: Selection, workers: int, country: Country | None,
) -> None:  # fmt: skip
    """Draw EPISODE (scenario_id or planner/scenario_id) of the run folder RUN from its trace, or a whole selection.

    A selection is drawn in parallel; what is already drawn is kept, so the same command continues after a break.
    """
    if episode is None and time is not None:
        raise InputError("--time chooses the moment of one EPISODE; a selection is drawn at its violations")
    pictures = picture_kind(kind, out if episode else None, time, country)
    make_and_tell(run, episode, selection, pictures, out, workers)
