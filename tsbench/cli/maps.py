"""`tsbench maps`: extracts, networks, the pool."""

from __future__ import annotations

from pathlib import Path

import click

from tsbench.cli import options
from tsbench.cli.console import bars, print_notes, print_table
from tsbench.make.city import load_city, made_pool, sources_dir
from tsbench.make.maps import extracts
from tsbench.make.maps.stats import CountTable, count_tables, draw_pool
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.map_pool import read_pool


@click.group()
def maps() -> None:
    """From OpenStreetMap extracts to the pool of maps."""


@maps.command()
@options.made_city
@click.argument("extract", type=options.PATH)
@options.out("Network to write, .net.xml or .net.xml.gz.", type=options.FILE, required=True)
def convert(data: DataSet, extract: Path, out: Path) -> None:
    """Convert an OSM EXTRACT (.osm, .gz, .bz2, .pbf) to a SUMO network."""
    from tsbench.make.maps.netconvert import convert_extract

    facts, city = convert_extract(data, extract, out), load_city(data.name)
    click.echo(
        f"{out}: from {facts.nodes:,} nodes, {facts.ways:,} ways, {facts.roads:,} of them roads for cars; "
        f"traffic on the {city.side}"
    )
    if facts.zone != city.zone:
        print_notes(
            [
                f"{extract}: lies in UTM zone {facts.zone}, {city.name} in {city.zone}, and has the side and limits of "
                f"{city.name}; describe its own city with `tsbench city new` and name that with --city"
            ]
        )
    print_notes(f"{extract}: {line}" for line in (*facts.notes, *facts.warnings))


@maps.command()
@options.made_city
@options.osm
@options.out("Pool index to write.  [default: sumo_nets/pool.parquet]", type=options.FILE)
@options.workers
def harvest(data: DataSet, osm_dir: Path | None, out: Path | None, workers: int) -> None:
    """Harvest all extracts of a folder into the pool. Interrupted, it goes on where it was."""
    from tsbench.make.maps.harvest import harvest as run_harvest

    target = out or made_pool(data)
    report = target.with_name("harvest.json")
    with bars() as show:
        result = run_harvest(data, osm_dir or sources_dir(), target, report, workers, show)
    print_notes(result.notes)
    _print_counts(count_tables(data, result.rows)[:2])
    print_table(("refused, by reason", "sum"), ((why, f"{n:,}") for why, n in result.refused.items()))
    click.echo(f"{result.rings} rings in all extracts; {len(result.rows):,} maps in {target}, counts in {report}")


@maps.command()
@click.option(
    "--pool", "pool_path", type=options.FILE, metavar="FILE", help="Pool index.  [default: sumo_nets/pool.parquet]"
)
@options.made_city
@options.png("Draw a map with every crop as a dot.")
def stats(data: DataSet, pool_path: Path | None, png: Path | None) -> None:
    """Count the pool by family, shape, lanes, curvature, length and source."""
    pool = read_pool(pool_path or data.pool_path)
    _print_counts(count_tables(data, pool))
    if png is not None:
        draw_pool(data, pool, png)
        click.echo(f"map: {png}")


@maps.command()
@click.argument("name")
@options.box
@options.out("Folder.  [default: sumo_nets/sources]", type=options.FOLDER)
def fetch(name: str, bbox: str, date: str | None, server: str | None, out: Path | None) -> None:
    """Fetch the roads of a box from OpenStreetMap as the extract NAME."""
    path = (out or sources_dir()) / f"{name}.osm.gz"
    digest = extracts.fetch_extract(path, extracts.address(extracts.parse_box(bbox), date, server or extracts.SERVER))
    click.echo(f"{path}: SHA-256 {digest}")


@maps.command()
@click.argument("map_ids", nargs=-1, required=True)
@options.made_city
@options.osm
@options.out("PNG file to draw.", type=options.FILE, required=True)
def show(data: DataSet, map_ids: tuple[str, ...], osm_dir: Path | None, out: Path) -> None:
    """Cut maps from their extracts and draw them on one sheet."""
    from tsbench.make.maps.map_sheet import draw_maps

    draw_maps(data, map_ids, osm_dir or sources_dir(), out)
    click.echo(f"{len(map_ids)} maps: {out}")


def _print_counts(tables: list[CountTable]) -> None:
    for counts in tables:
        rows = [(name, *(f"{number:,}" for number in numbers)) for name, numbers in counts.rows]
        print_table(("", *counts.columns), rows, title=counts.title)
