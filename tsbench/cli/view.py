"""`tsbench view`."""

from __future__ import annotations

from pathlib import Path

import click

_RUNS = Path("runs")


@click.command()
@click.argument("runs", metavar="[RUN…]", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "--port", type=click.IntRange(0, 65535), default=8765, show_default=True, help="0: any that is free."
)
def view(runs: tuple[Path, ...], port: int) -> None:
    """Serve the reports of RUNs (default: all below runs/) to a browser on this machine, until Ctrl-C.

    Every traced episode can be played: its trace is read when it is asked for.
    """
    from tsbench.report.page.server import HOST, make_server, runs_below  # brings matplotlib
    from tsbench.run.log.read import is_run

    for run in runs:
        if not is_run(run):
            raise click.UsageError(f"{run}: no run folder (it has no run.json)")
    server = make_server(runs or runs_below(_RUNS), port)
    click.echo(f"serving on http://{HOST}:{server.server_address[1]}/ (Ctrl-C ends it)")
    try:
        server.serve_forever()
    finally:
        server.server_close()
