"""`tsbench oracle`: what the best expert does on each train scenario, as data to learn from."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from tsbench.cli import EXIT_FAILED, EXIT_INTERRUPTED, options
from tsbench.cli.analyse import out as analysis_out
from tsbench.cli.console import show_analysis
from tsbench.cli.options import Words
from tsbench.core.benchmark import VARIANTS
from tsbench.core.streams import progress_console
from tsbench.learn.oracle.collect import LEAST_LEARNED_VARIANTS, TRIES, Collected, CollectOptions, experts
from tsbench.learn.oracle.collect import collect as collect_drives
from tsbench.learn.oracle.select import select as select_drives
from tsbench.learn.oracle.select import stats as stats_of
from tsbench.learn.oracle.select import verify as verify_drives
from tsbench.learn.oracle.trajectories import trajectories_path
from tsbench.run.listener import ProgressWatcher
from tsbench.run.options import RunOptions
from tsbench.scenarios.data_set import DataSet

_FOLDER = "runs/oracle"
_split = options.split("train")
_folder = click.argument("folder", metavar="[DIR]", type=options.FOLDER, default=_FOLDER)


@click.group()
def oracle() -> None:
    """All experts on the train scenarios; the best drives become the data that plant2-ft learns from."""


@oracle.command()
@_split
@options.types
@options.limit("Scenarios: types in turn, nominal first; of one per map, drawn at random.")
@options.one_of(RunOptions, "variants")
@options.planners("Expert to drive; default: all that are registered")
@options.count(
    "--learned-variants",
    least=LEAST_LEARNED_VARIANTS,
    most=VARIANTS,
    default=VARIANTS,
    help="Variants of a map that experts with networks drive, drawn at random.",
)
@options.count(
    "--tries",
    default=TRIES,
    help="Drives of a scenario by one expert at most, each with another driver, until one succeeds.",
)
@options.run_workers
@options.out("Folder; one with part of a collection is continued.", _FOLDER, type=options.FOLDER)
@click.option("--redrive", is_flag=True, help="Drive again what other code of an expert has driven.")
def collect(
    data: DataSet,
    split: str,
    types: Words,
    limit: int | None,
    variants: str,
    planners: Words,
    tries: int,
    **others: Any,
) -> None:
    """Drive each expert on each scenario; the same command continues, other experts and scenarios are added.

    Exit codes: 0 complete, 1 with drives that broke off, 2 wrong usage or bad input, 130 interrupted.
    """
    request = RunOptions(planners or experts(), split, types, limit, variants)
    asked = CollectOptions(request=request, tries=tries, **others)
    found = collect_drives(data, asked, ProgressWatcher(progress_console()))
    _tell(found, tries)
    if not found.complete:
        sys.exit(EXIT_INTERRUPTED)
    if any(t.errors for t in found.experts.values()):
        sys.exit(EXIT_FAILED)


@oracle.command()
@_folder
@options.city
@options.trajectories
@options.allow_partial
def select(folder: Path, data: DataSet, trajectories: Path | None, allow_partial: bool) -> None:
    """Keep the best two successful drives of each scenario of the collection DIR (default: runs/oracle)."""
    found = select_drives(data, folder, trajectories or trajectories_path(), allow_partial)
    share = 100.0 * found.covered / found.scenarios if found.scenarios else 0.0
    click.echo(
        f"{found.drives} drives of {found.covered} of {found.scenarios} driven scenarios ({share:.2f} %): "
        f"{found.drives - found.validation} to train, {found.validation} to validate on; "
        f"{found.others} more are not among the best"
    )
    for kind, count in found.uncovered.items():
        click.echo(f"without a drive: {count} of {kind}")
    click.echo(f"table     {found.path} ({found.path.stat().st_size / 1e6:.2f} MB)")


@oracle.command()
@_split
@options.trajectories
@analysis_out("oracle.csv, oracle.tex, oracle.md, oracle.png and oracle.svg")
def stats(data: DataSet, split: str, trajectories: Path | None, out: Path) -> None:
    """Coverage, and whose drives were chosen, by group: a table and a figure."""
    show_analysis(stats_of(data, trajectories or trajectories_path(), split), out)


@oracle.command()
@_split
@options.trajectories
@options.limit("So many drives, drawn at random; default: all.")
def verify(data: DataSet, split: str, trajectories: Path | None, limit: int | None) -> None:
    """Replay chosen drives and compare each with its fingerprints."""
    count = verify_drives(data, trajectories or trajectories_path(), split, limit)
    click.echo(f"{count} drives replayed, all as recorded")


@oracle.command()
@_split
@options.trajectories
@options.limit("So many drives, the table's first; default: all.")
@click.option("--rank", type=click.IntRange(0), default=1, show_default=True, help="Drives up to this rank; 0: all.")
@options.out("File to write.", "oracle-ticks.parquet", type=options.FILE)
def export(data: DataSet, split: str, trajectories: Path | None, limit: int | None, rank: int, out: Path) -> None:
    """Drive chosen drives again and write their ticks: state, plates, lanes, action, reward terms."""
    from tsbench.learn.oracle.export import export as export_drives

    drives, ticks = export_drives(data, trajectories or trajectories_path(), split, out, rank, limit)
    click.echo(f"{drives} drives, {ticks} ticks in {out} ({out.stat().st_size / 1e6:.2f} MB)")


def _tell(found: Collected, tries: int) -> None:
    for name, t in found.experts.items():
        click.echo(
            f"{name}: {t.finished} of {t.asked} scenarios, {t.solved} solved ({t.at_once} at once), {t.drives} drives"
            + (f", {t.errors} broke off" if t.errors else "")
            + ("; failed ones not repeated: it draws no driver" if t.longest == 1 < tries else "")
        )
    click.echo(f"tries     {found.folder / 'tries.parquet'}")
    if any(t.errors for t in found.experts.values()):
        click.echo(f"errors    {found.folder / 'errors'}")
    if not found.complete:
        click.echo("run the same command again to continue")
