"""`tsbench maps`: extracts, networks, the pool."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Column, Table

if TYPE_CHECKING:
    from tsbench.dataset.maps.stats import CountTable

PATH = click.Path(path_type=Path)


@click.group()
def maps() -> None:
    """From OpenStreetMap extracts to the pool of maps."""


@maps.command()
@click.argument("extract", type=PATH)
@click.option("--out", type=PATH, required=True, help="Network to write, .net.xml or .net.xml.gz.")
def convert(extract: Path, out: Path) -> None:
    """Convert an OSM EXTRACT (.osm, .gz, .bz2, .pbf) to a SUMO network."""
    from tsbench.dataset.maps.convert import convert_extract

    facts = convert_extract(extract, out)
    click.echo(
        f"{out}: from {facts.nodes:,} nodes, {facts.ways:,} ways, {facts.roads:,} of them roads for cars"
    )


@maps.command()
@click.option("--osm", "osm_dir", type=PATH, help="Folder of extracts.  [default: sumo_nets/sources]")
@click.option("--out", type=PATH, help="Pool index to write.  [default: sumo_nets/pool.parquet]")
@click.option("--workers", type=click.IntRange(1, 64), default=2, show_default=True)
def harvest(osm_dir: Path | None, out: Path | None, workers: int) -> None:
    """Harvest all extracts of a folder into the pool. Interrupted, it goes on where it was."""
    from tsbench.dataset.maps import paths
    from tsbench.dataset.maps.harvest import harvest as run_harvest
    from tsbench.dataset.maps.stats import count_tables

    target = out or paths.sumo_nets() / "pool.parquet"
    report = target.with_name("harvest.json")
    columns = (TextColumn("{task.description:>14}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True)) as progress:
        tasks: dict[str, TaskID] = {}

        def show(what: str, done: int, total: int) -> None:
            if what not in tasks:
                tasks[what] = progress.add_task(what, total=total)
            progress.update(tasks[what], completed=done, total=total)

        result = run_harvest(osm_dir or paths.sources_dir(), target, report, workers, show)
    _print_counts(count_tables(result.rows)[:2])
    refused = Table("refused, by reason", Column("sum", justify="right"), box=SIMPLE_HEAD)
    for reason, number in result.refused.items():
        refused.add_row(reason, f"{number:,}")
    Console().print(refused)
    click.echo(
        f"{result.rings} rings in all extracts; {len(result.rows):,} maps in {target}, counts in {report}"
    )


@maps.command()
@click.option("--pool", "pool_path", type=PATH, help="Pool index.  [default: sumo_nets/pool.parquet]")
@click.option("--png", type=PATH, help="Draw a map with every crop as a dot.")
def stats(pool_path: Path | None, png: Path | None) -> None:
    """Count the pool by family, shape, lanes, curvature, length and source."""
    from tsbench.dataset.maps.stats import count_tables, draw_pool
    from tsbench.scenarios.map_pool import pool_file, read_pool

    pool = read_pool(pool_path or pool_file())
    _print_counts(count_tables(pool))
    if png is not None:
        draw_pool(pool, png)
        click.echo(f"map: {png}")


@maps.command()
@click.argument("place", required=False)
@click.option("--bbox", help="west,south,east,north in degrees, instead of a place.")
@click.option("--name", help="Name of the extract; made from the place by default.")
@click.option("--out", "out_dir", type=PATH, help="Folder.  [default: sumo_nets/sources]")
def fetch(place: str | None, bbox: str | None, name: str | None, out_dir: Path | None) -> None:
    """Fetch the roads of a PLACE or box from OpenStreetMap (extra `fetch`)."""
    from tsbench.dataset.maps import paths
    from tsbench.dataset.maps.fetch import fetch_extract, parse_box

    box = parse_box(bbox) if bbox is not None else None
    got = fetch_extract(out_dir or paths.sources_dir(), name=name, place=place, box=box)
    click.echo(f"{got.path}: {'cached' if got.cached else 'fetched'}, SHA-256 {got.sha256}")


@maps.command()
@click.argument("map_ids", nargs=-1, required=True)
@click.option("--osm", "osm_dir", type=PATH, help="Folder of extracts.  [default: sumo_nets/sources]")
@click.option("--png", type=PATH, required=True, help="Sheet to draw.")
def show(map_ids: tuple[str, ...], osm_dir: Path | None, png: Path) -> None:
    """Cut maps from their extracts and draw them on one sheet."""
    from tsbench.dataset.maps import paths
    from tsbench.report.map_sheet import draw_maps

    draw_maps(map_ids, osm_dir or paths.sources_dir(), png)
    click.echo(f"{len(map_ids)} maps: {png}")


def _print_counts(tables: list[CountTable]) -> None:
    console = Console()
    for counts in tables:
        table = Table(
            Column("", no_wrap=True),
            title=counts.title,
            title_justify="left",
            box=SIMPLE_HEAD,
            pad_edge=False,
        )
        for column in counts.columns:
            table.add_column(column, justify="right")
        for name, numbers in counts.rows:
            table.add_row(name, *(f"{number:,}" for number in numbers), style="bold" if name == "all" else "")
        console.print(table)
