"""`tsbench report`."""

from __future__ import annotations

from pathlib import Path

import click

from tsbench.core.machine import own_cores


@click.command()
@click.argument("runs", metavar="RUN…", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Default: report.html in the run, or here for several.",
)
@click.option(
    "--allow-partial", is_flag=True, help="Report runs with missing records too; the title says so."
)
@click.option(
    "--max-mb",
    type=click.FloatRange(min=0.1),
    default=20.0,
    show_default=True,
    metavar="MB",
    help="Largest size of the file; players are left out, violations last.",
)
@click.option("--workers", type=click.IntRange(min=1), metavar="N", help="Processes; default: one per core.")
def report(
    runs: tuple[Path, ...], out: Path | None, allow_partial: bool, max_mb: float, workers: int | None
) -> None:
    """Write one self-contained HTML page about RUNs: all figures, all episodes, and a player for those with a trace.

    Runs of one page must have one contract and one selection of scenarios.
    """
    from rich.console import Console
    from rich.progress import Progress

    from tsbench.report.page.report import MEGABYTE, write_report  # brings matplotlib

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("players", total=None)
        written = write_report(
            runs, out, allow_partial=allow_partial, max_mb=max_mb,
            workers=workers or own_cores(),
            progress=lambda done, of: bar.update(task, completed=done, total=of),
        )  # fmt: skip
    for note in written.notes:
        click.echo(f"note: {note}", err=True)
    each = f", {written.player_bytes / written.players / 1000:.1f} kB each" if written.players else ""
    click.echo(f"report    {written.path} ({written.size / MEGABYTE:.1f} MB)")
    click.echo(
        f"players   {written.players} of {written.traced} traced episodes, {written.episodes} in all{each}"
    )
