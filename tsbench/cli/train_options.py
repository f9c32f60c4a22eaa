"""What the commands of `tsbench train` share: options, the rows that are learned from, and what is said at the end."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from tsbench.cli.options import Option
from tsbench.planners.common.batching import DEVICES

if TYPE_CHECKING:
    from tsbench.planners.weights import Network
    from tsbench.scenarios.spec import ScenarioSpec

FOLDER = click.Path(path_type=Path, file_okay=False)

seed = click.option("--seed", default=0, show_default=True, type=click.IntRange(min=0))
types = click.option("--types", default="", metavar="TYPE,GROUP,…", help="Default: all.")
device = click.option("--device", type=click.Choice(DEVICES), default="cpu", show_default=True)
cache_gb = click.option(
    "--cache-gb",
    default=8.0,
    show_default=True,
    type=click.FloatRange(min=0.1),
    help="Bound of frames on disk.",
)
workers = click.option(
    "--workers", type=click.IntRange(min=1), metavar="N",
    help="Processes that drive, threads that learn; default: one per core.",
)  # fmt: skip


def out(default: str) -> Option:
    """Where a training keeps what it makes."""
    return click.option(
        "--out", type=click.Path(path_type=Path), default=default, show_default=True, metavar="DIR",
        help="Folder of the training; what it holds of it already is continued.",
    )  # fmt: skip


def train_rows(words: tuple[str, ...]) -> list[ScenarioSpec]:
    """The train table's rows of some types and groups; of all where none is named."""
    from tsbench.scenarios.store import check_files
    from tsbench.scenarios.table import read_table, table_path

    rows = read_table(table_path("train"))
    if words:
        chosen = types_of(words)
        rows = [row for row in rows if row.scenario_type in chosen]
    check_files(rows)
    return rows


def types_of(words: tuple[str, ...]) -> tuple[str, ...]:
    """The types that some types and groups are; none where none is named."""
    from tsbench.run.plan import choose_types
    from tsbench.signs.catalog import load_catalog

    return tuple(sorted(choose_types(words, load_catalog()))) if words else ()


def tell(out: Path, made: Network) -> None:
    """Where everything is."""
    weights = f"{made.weights.size / 1e6:.1f} MB, {made.parameters:,} parameters"
    click.echo(f"weights   {out / made.weights.file} ({weights})")
    click.echo(f"facts     {out / made.name}.json")
    click.echo(f"curve     tensorboard --logdir {out / 'tensorboard'}")
