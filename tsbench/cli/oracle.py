"""`tsbench oracle`: what the best expert does on each train scenario, as data to learn from."""

from __future__ import annotations

import sys
from pathlib import Path

import click
from rich.console import Console

from tsbench.cli import EXIT_INTERRUPTED
from tsbench.cli.analyse import write_files
from tsbench.cli.console import table_console
from tsbench.cli.options import words_of
from tsbench.learn.oracle.collect import LEAST_LEARNED_VARIANTS, TRIES, Collected, CollectOptions, experts
from tsbench.learn.oracle.collect import VARIANTS as ALL_VARIANTS
from tsbench.learn.oracle.collect import collect as collect_drives
from tsbench.learn.oracle.restore import restore as restore_drives
from tsbench.learn.oracle.select import select as select_drives
from tsbench.learn.oracle.stats import stats as stats_of
from tsbench.learn.oracle.stats import verify as verify_drives
from tsbench.learn.oracle.trajectories import trajectories_path
from tsbench.run.plan import VARIANTS, Request
from tsbench.run.progress import ProgressWatcher
from tsbench.scenarios.table import SPLITS

EXIT_ERRORS = 1
_FOLDER = Path("runs/oracle")
_split = click.option(
    "--split", type=click.Choice(SPLITS), default="train", show_default=True, help="Scenario table."
)
_table = click.option(
    "--table", type=click.Path(path_type=Path), metavar="FILE",
    help="The chosen drives. Default: scenarios/oracle.parquet of the data folder.",
)  # fmt: skip


@click.group()
def oracle() -> None:
    """All experts on the train scenarios; the best drives become the data that plant2-ft learns from."""


@oracle.command()
@_split
@click.option("--types", metavar="TYPE,GROUP,…", default="", help="Scenario types or groups; default: all.")
@click.option(
    "--limit",
    type=click.IntRange(min=1),
    metavar="N",
    help="Scenarios: types in turn, nominal first; of one per map, by lot.",
)
@click.option(
    "--variants", type=click.Choice(VARIANTS), default="all", show_default=True,
    help="The nominal variant, all, or one drawn for each map.",
)  # fmt: skip
@click.option("--planners", metavar="NAME,…", default="", help="Experts; default: all that are registered.")
@click.option(
    "--learned-variants", type=click.IntRange(LEAST_LEARNED_VARIANTS, ALL_VARIANTS), default=ALL_VARIANTS,
    show_default=True, metavar="N", help="Variants of a map that experts with networks drive, drawn by lot.",
)  # fmt: skip
@click.option(
    "--tries", type=click.IntRange(min=1), default=TRIES, show_default=True, metavar="N",
    help="Drives of a scenario by one expert at most, each with another driver, until one succeeds.",
)  # fmt: skip
@click.option("--workers", type=click.IntRange(min=1), metavar="N", help="Processes; default: one per core.")
@click.option(
    "--out", type=click.Path(path_type=Path), default=_FOLDER, show_default=True, metavar="DIR",
    help="Folder; one with part of a collection is continued.",
)  # fmt: skip
@click.option("--redrive", is_flag=True, help="Drive again what other code of an expert has driven.")
def collect(
    split: str, types: str, limit: int | None, variants: str, planners: str, learned_variants: int, tries: int,
    workers: int | None, out: Path, redrive: bool,
) -> None:  # fmt: skip
    """Drive each expert on each scenario; the same command continues, other experts and scenarios are added.

    Exit codes: 0 complete, 1 with drives that broke off, 2 wrong usage or bad input, 130 interrupted.
    """
    request = Request(words_of(planners) or experts(), split, words_of(types), limit, variants)
    options = CollectOptions(request, out, learned_variants, tries, workers, redrive=redrive)
    found = collect_drives(options, ProgressWatcher(Console(stderr=True)))
    _tell(found, tries)
    if not found.complete:
        sys.exit(EXIT_INTERRUPTED)
    if any(t.errors for t in found.experts.values()):
        sys.exit(EXIT_ERRORS)


@oracle.command()
@click.argument("folder", metavar="[DIR]", type=click.Path(path_type=Path), default=_FOLDER)
@_table
@click.option("--allow-partial", is_flag=True, help="Choose from a collection that is not finished too.")
def select(folder: Path, table: Path | None, allow_partial: bool) -> None:
    """Keep the best two successful drives of each scenario of the collection DIR (default: runs/oracle)."""
    found = select_drives(folder, table or trajectories_path(), allow_partial)
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
@click.argument("folder", metavar="[DIR]", type=click.Path(path_type=Path), default=_FOLDER)
@_table
def restore(folder: Path, table: Path | None) -> None:
    """Begin the collection DIR (default: runs/oracle) with what the chosen drives and their tries hold.

    `tsbench oracle collect` then adds experts or scenarios to it.
    """
    click.echo(f"{restore_drives(table or trajectories_path(), folder)} experts' scenarios in {folder}")


@oracle.command()
@_split
@_table
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("analyses"), show_default=True, metavar="DIR",
    help="Folder for oracle.csv, oracle.tex, oracle.png and oracle.svg.",
)  # fmt: skip
def stats(split: str, table: Path | None, out: Path) -> None:
    """Coverage, and whose drives were chosen, by group: a table and a figure."""
    from tsbench.report.analyses.shown import print_analysis

    analysis = stats_of(table or trajectories_path(), split)
    print_analysis(analysis, table_console())
    write_files(analysis, out)


@oracle.command()
@_split
@_table
@click.option(
    "--limit", type=click.IntRange(min=1), metavar="N", help="So many drives, drawn by lot; default: all."
)
def verify(split: str, table: Path | None, limit: int | None) -> None:
    """Replay chosen drives and compare each with its fingerprints."""
    count = verify_drives(table or trajectories_path(), split, limit)
    click.echo(f"{count} drives replayed, all as recorded")


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
