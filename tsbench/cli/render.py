"""`tsbench render`: an episode of a run as PNG, GIF or MP4."""

from __future__ import annotations

from pathlib import Path

import click

from tsbench.cli.options import jurisdiction_option
from tsbench.report.render import FORMATS, render_episode
from tsbench.signs.countries import Country


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.argument("episode", metavar="EPISODE")
@click.option(
    "--format", "kind", type=click.Choice(FORMATS), default=None, help="Default: png, or --out's suffix."
)
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", help="Default: below RUN/pictures/.")
@click.option(
    "--time", type=float, metavar="S", help="Moment of a PNG; default: the violation, else half-way."
)
@jurisdiction_option
def render(
    run: Path, episode: str, kind: str | None, out: Path | None, time: float | None, country: Country | None
) -> None:
    """Draw EPISODE (scenario_id or planner/scenario_id) of the run folder RUN from its trace."""
    click.echo(str(render_episode(run, episode, kind, out, time, country)))
