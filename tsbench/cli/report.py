"""`tsbench failures`, `tsbench report`, `tsbench view` and `tsbench compare`: what came of runs."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from tsbench.cli import options
from tsbench.cli.console import bars, table_console
from tsbench.core.errors import InputError
from tsbench.metrics.aggregate import name_holes
from tsbench.report.analyses.analysis import print_analysis
from tsbench.report.compare_runs import compare_runs, flips_csv, print_comparison, standing
from tsbench.report.run_ending import GROUPINGS, failures_of, listing
from tsbench.run.log.read import is_run, read_run

_LARGEST = "Largest size of the file; players are left out, violations last."


@click.command()
@click.argument("run", type=options.PATH)
@options.choice("--by", tuple(GROUPINGS), "planner", "What they are grouped by; the largest group first.")
@click.option("--json", "as_json", is_flag=True, help="A list for programs, in no groups.")
@options.allow_partial
def failures(run: Path, by: str, as_json: bool, allow_partial: bool) -> None:
    """Count the episodes of the run folder RUN without SCD, then list them: which half, its end, what happened."""
    stored = read_run(run)
    partial = name_holes({name: stored.holes(name) for name in stored.asked}, stored.asked, allow_partial)
    found = failures_of(stored)
    if as_json:
        click.echo(json.dumps([asdict(failure) for failure in found], ensure_ascii=False, indent=1))
        return
    if partial:
        click.echo(f"PARTIAL, scenarios without a record ({partial})")
    for line in listing(stored, found, by):
        click.echo(line)


@click.command()
@options.runs
@options.out("Default: report.html in the run, or here for several.", type=options.FILE)
@options.allow_partial
@click.option("--max-mb", type=click.FloatRange(min=0.1), default=20.0, show_default=True, metavar="MB", help=_LARGEST)
@options.workers
def report(runs: tuple[Path, ...], out: Path | None, **asked: Any) -> None:
    """Write one self-contained HTML page about RUNs: all figures, all episodes, and a player for those with a trace.

    The other half of a failure is driven again where it has no trace, and has one then. Runs of one page must have one
    contract and one selection of scenarios.
    """
    from tsbench.report.page.report_page import MEGABYTE, write_report  # brings matplotlib

    with bars() as show:
        written = write_report(runs, out, progress=lambda done, of: show("players", done, of), **asked)
    for note in written.notes:
        click.echo(f"note: {note}", err=True)
    each = f", {written.player_bytes / written.players / 1000:.1f} kB each" if written.players else ""
    click.echo(f"report    {written.path} ({written.size / MEGABYTE:.1f} MB)")
    click.echo(f"players   {written.players} of {written.playable} playable episodes, {written.episodes} in all{each}")


@click.command()
@click.argument("runs", metavar="[RUN…]", nargs=-1, type=options.PATH)
@click.option("--port", type=click.IntRange(0, 65535), default=8765, show_default=True, help="0: any that is free.")
def view(runs: tuple[Path, ...], port: int) -> None:
    """Serve the reports of RUNs (default: all below runs/) to a browser on this machine, until Ctrl-C.

    Every traced episode can be played. The other half of a failure is driven again, and has a trace then, where it has
    none; a line of the page says so.
    """
    from tsbench.report.page.report_server import HOST, make_server, runs_below  # brings matplotlib

    for run in runs:
        if not is_run(run):
            raise click.UsageError(f"{run}: no run folder (it has no run.json)")
    server = make_server(runs or runs_below(Path("runs")), port)
    click.echo(f"serving on http://{HOST}:{server.server_address[1]}/ (Ctrl-C ends it)")
    try:
        server.serve_forever()
    finally:
        server.server_close()


@click.command()
@click.argument("run_a", type=options.TEXT, metavar="RUN_A[:PLANNER]", shell_complete=options.registered_names)
@click.argument(
    "runs_b",
    nargs=-1,
    required=True,
    type=options.TEXT,
    metavar="RUN_B[:PLANNER]…",
    shell_complete=options.registered_names,
)
@click.option("--force", is_flag=True, help="Compare different contracts, or what different scenarios share.")
@options.allow_partial
@options.png("Draw the differences.")
@click.option("--csv", type=options.FILE, metavar="FILE", help="Write all flips.")
@options.count("--flips", least=0, default=20, help="Flipped scenarios to list, of the lost and of the won each.")
def compare(
    run_a: str,
    runs_b: tuple[str, ...],
    force: bool,
    allow_partial: bool,
    png: Path | None,
    csv: Path | None,
    flips: int,
) -> None:
    """Compare planners scenario by scenario, each RUN_B with RUN_A: what changed by type and group, and what flipped.

    A run with several planners is given as RUN:PLANNER. A planner's name alone, such as plant2-ft, stands for the
    results that come with tsbench. B-A is shown: more is better for B. Runs of different contracts or scenarios are
    refused unless forced.
    """
    if len(runs_b) > 1 and (csv or png):
        raise InputError("--csv and --png are of one comparison: give one RUN_B")
    found = [compare_runs(run_a, run_b, force=force, allow_partial=allow_partial) for run_b in runs_b]
    for matched in found:
        print_comparison(matched, table_console(), flips)
    print_analysis(standing(found), table_console())
    matched = found[0]
    if csv is not None:
        flips_csv(matched.comparison, csv)
        click.echo(f"flips     {csv}")
    if png is not None:
        from tsbench.report.forest import draw_forest  # brings matplotlib

        draw_forest(matched, png)
        click.echo(f"picture   {png}")
