"""`tsbench city`: list, show, build. `tsbench seal`: secret, build, commit, check."""

from __future__ import annotations

from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from tsbench.board.seal import Commitments, build_sealed, commitments, make_secret, problems
from tsbench.cli import options
from tsbench.cli.console import bars, print_notes, print_table
from tsbench.core.errors import InputError, TsbenchError
from tsbench.core.files import write_json
from tsbench.core.paths import MIRRORED, city_names
from tsbench.core.typed import read_typed
from tsbench.make.city import describe_city, fetch_extracts, find_extract, load_city, new_city_file, sources_dir
from tsbench.make.maps import extracts
from tsbench.make.maps.extracts import ending_of
from tsbench.make.maps.stats import draw_pool
from tsbench.make.scenes.overview import build_report, carried, report_file
from tsbench.make.scenes.recipe import load_recipes
from tsbench.run.edition import edition_now
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.map_pool import read_pool
from tsbench.signs.countries import Country, city_country, country_code

if TYPE_CHECKING:
    from tsbench.make.city import City
    from tsbench.scenarios.map_pool import PoolRow


@click.group()
def city() -> None:
    """Data sets of other cities, made from their OpenStreetMap extracts (docs/guides/city.md)."""


@city.command("list")
def list_() -> None:
    """The cities that are described, and what was built of them."""
    rows = []
    for name in city_names():
        data, found = DataSet.named(name), load_city(name)
        built = [f"{split} {len(data.table(split)):,}" for split in data.splits]
        dates = ", ".join(sorted({extract.date for extract in found.extracts}))
        rows.append(
            (name, found.title, found.country, found.side, str(found.frame), dates, ", ".join(built) or "nothing")
        )
    print_table(("city", "what", "country", "side", "frame", "extracts of", "rows built"), rows, left=7)
    click.echo(f"--city {MIRRORED}NAME: the data set of NAME in a mirror, with traffic on the other side")


@city.command()
@options.city_name
@options.png("Draw a map with every crop as a dot.")
@click.option("--streets", is_flag=True, help="Also what kind of streets it has, from its extracts, by OSMnx.")
@click.option("--rose", type=options.FILE, metavar="FILE", help="Draw a compass rose of each extract's streets.")
@options.osm
def show(data: DataSet, png: Path | None, streets: bool, rose: Path | None, osm_dir: Path | None) -> None:
    """The extracts of a city, its maps, and which types it carries: on how many maps, and why not on more."""
    found = load_city(data.name)
    click.echo(found.title)
    _show_country(found.country, city_country(data.city))
    for extract in found.extracts:
        click.echo(f"{extract.sha256} {extract.name}, {extract.date}, {extract.licence}: {extract.address}")
    if streets or rose is not None:
        _show_streets(data, found, osm_dir, rose)
    if not data.pool_path.is_file():
        click.echo(f"nothing is built yet: tsbench city build {found.name} --osm DIR")
        return
    pool = read_pool(data.pool_path)
    _show_types(data, found, pool)
    if png is not None:
        draw_pool(data, pool, png)
        click.echo(f"map: {png}")


def _show_streets(data: DataSet, city: City, osm_dir: Path | None, rose: Path | None) -> None:
    """Statistics of the street network of each extract, and a picture of the directions of its streets."""
    from tsbench.make.maps.streets import draw_bearings, graph_of, streets_of

    files = {one.name: find_extract(data, one.name, osm_dir or sources_dir()) for one in city.extracts}
    graphs = {extract: graph_of(file) for extract, file in files.items()}
    rows = []
    for extract, graph in graphs.items():
        s = streets_of(extract, graph)
        arms = " / ".join(f"{100.0 * share:.0f}" for share in s.arms.values())
        rows.append(
            (
                s.extract, f"{s.area_km2:.1f}", f"{s.street_km:.0f}", f"{s.intersections:,}", f"{s.density:.1f}", arms,
                f"{100.0 * s.dead_ends:.0f}", f"{s.segment_m:.0f}", f"{s.circuity:.3f}", f"{s.entropy:.2f}",
            )
        )  # fmt: skip
    heads = (
        "extract", "km2", "streets km", "intersections", "per km2", "3 / 4 / 5+ arms %", "dead ends %", "segment m",
        "circuity", "orientation entropy",
    )  # fmt: skip
    print_table(heads, rows)
    if rose is not None:
        draw_bearings(graphs, rose)
        click.echo(f"rose: {rose}")


def _show_country(code: str, country: Country | None) -> None:
    """What holds where no plate says otherwise, and whose plates pictures show."""
    if country is None or country.traffic is None:
        click.echo(f"country {code}: no figures; plates and units are the catalogue's")
        return
    traffic = country.traffic
    speeds = ", ".join(f"{road} {speed:g}" for road, speed in traffic.speeds.items())
    click.echo(
        f"country {code}, {country.name_en}: traffic on the {traffic.side}; "
        f"junctions without signs: {traffic.unsigned.replace('_', ' ')}; plates: {country.count} of "
        f"{len(country.equivalents)} with its number; speeds in {traffic.unit}: {speeds}"
    )


_EXTRACT = "An extract that is there, or the folder to fetch one into.  [default: sumo_nets/sources]"


@city.command()
@click.argument("name")
@options.box_or_file
@click.option("--place", metavar="TEXT", help="In place of a box: the outline of a place, by its name.")
@click.option("--geocoder", metavar="URL", help="Who knows places.  [default: nominatim.openstreetmap.org]")
@click.option("--country", required=True, metavar="CODE", help="Its two letters of ISO 3166, such as de.")
@click.option("--title", metavar="TEXT", help="A line for tables.  [default: NAME]")
@click.option("--ground", is_flag=True, help="Also fetch buildings, greenery and water, for pictures.")
@click.option("--address", metavar="TEXT", help="Where FILE can be had.  [default: its name]")
@click.option("--osm", "osm", type=options.PATH, metavar="FILE|DIR", help=_EXTRACT)
def new(
    name: str,
    bbox: str | None,
    date: str | None,
    server: str | None,
    place: str | None,
    geocoder: str | None,
    country: str,
    title: str | None,
    ground: bool,
    address: str | None,
    osm: Path | None,
) -> None:
    """Describe an extract, or the roads of a box or place that are fetched, as the city NAME in cities/NAME.yaml."""
    from tsbench.make.maps.own_extract import GEOCODER, facts_of, outline_of

    file, code = new_city_file(name), country_code(country, "--country")
    if osm is not None and not osm.is_dir() and ending_of(osm.name):
        if bbox or place or server or ground:
            raise InputError(f"--osm {osm}: a file has its roads: leave out --bbox, --place, --server and --ground")
        path = osm
    elif (bbox is None) == (place is None) or address:
        raise InputError("name the roads: --bbox W,S,E,N or --place NAME of what is to be fetched, or --osm FILE")
    else:
        area: extracts.Box | extracts.Outline
        if place is not None:
            area = outline_of(place, geocoder or GEOCODER)
            extracts.check_outline(place, area)
        else:
            area = extracts.parse_box(bbox or "")
        path, date = (osm or sources_dir()) / f"{name}.osm.gz", date or f"{datetime.now(UTC):%Y-%m-%d}"
        address = extracts.address(area, date, server or extracts.SERVER, ground)
        extracts.fetch_extract(path, address)
    zone, facts, left_out = facts_of(path, date, address)
    describe_city(file, title or place or name, code, zone, facts)
    click.echo(
        f"{path}: SHA-256 {facts['sha256']}, OpenStreetMap of {facts['date']}, UTM zone {zone}\n"
        f"{file}: look through it, then tsbench city build {name} --osm {path.parent}"
    )
    print_notes(f"{path}: {line}" for line in left_out)


@city.command()
@click.argument("name")
@options.osm
def fetch(name: str, osm_dir: Path | None) -> None:
    """Fetch a city's extracts that are not there, each from its address, and check them."""
    fetch_extracts(name, osm_dir or sources_dir(), click.echo)


@city.command()
@options.city_name
@options.types
@options.osm
@options.workers
def build(data: DataSet, types: tuple[str, ...], osm_dir: Path | None, workers: int) -> None:
    """Build a city's data set: pool, pairs of every type in dev and test, certificates. Resumable."""
    from tsbench.make.scenes.build import build_city

    chosen, found = options.types_of(data, types), load_city(data.name)
    with bars() as show:
        build_city(data, chosen, osm_dir or sources_dir(), workers, show, lambda note: print_notes([note]))
    _show_types(data, found, read_pool(data.pool_path), chosen)
    there = [split for split in data.splits if data.table(split)]
    split = "test" if "test" in there else there[0]
    click.echo(f"{edition_now(data)}: tsbench run --city {found.name} --split {split} --planner idm")


@city.command("ground")
@options.city_name
@options.osm
def write_surfaces(data: DataSet, osm_dir: Path | None) -> None:
    """Add buildings, greenery and water to the pictures of a built city, from its extracts."""
    from tsbench.make.maps.ground import write_ground

    path, maps = write_ground(data, osm_dir or sources_dir())
    told = ", ".join(f"{kind} on {count:,}" for kind, count in maps.items())
    click.echo(f"{path}: {path.stat().st_size:,} bytes; maps: {told}")


def _show_types(data: DataSet, city: City, pool: list[PoolRow], types: tuple[str, ...] = ()) -> None:
    """What a city carries."""
    recipes = load_recipes(data.catalog, types)
    found = carried(city, pool, recipes, build_report(path) if (path := report_file(data)).is_file() else [])
    rows = [(c.type_id, c.split, f"{c.there:,}", f"{c.maps} of {c.wanted}", c.why) for c in found]
    print_table(("type", "split", "maps there", "built", "why not more"), rows, title=f"{len(pool):,} maps", left=2)


_SECRET = "--secret"


@click.group()
def seal() -> None:
    """Scenes that nobody can prepare for, and the proof that they were not changed later (docs/holdout.md)."""


@seal.command()
@click.argument("file", type=options.FILE)
def secret(file: Path) -> None:
    """Make a secret. Who has it can make the scenes: keep it to yourself until they are published."""
    make_secret(file)
    click.echo(f"{file}: a secret of 256 bits")


@seal.command("build")
@options.city_name
@click.option(_SECRET, required=True, type=options.FILE, help="The file of the secret.")
@options.types
@options.osm
@options.workers
def build_with_secret(data: DataSet, secret: Path, types: tuple[str, ...], osm_dir: Path | None, workers: int) -> None:
    """Build the city NAME's data set as `tsbench city build` does, drawn with a secret. Resumable."""
    chosen = options.types_of(data, types)
    with bars() as show:
        build_sealed(data, chosen, osm_dir or sources_dir(), secret, workers, show)
    click.echo(f"{edition_now(data)}: tsbench seal commit {data.name} --out FILE")


@seal.command()
@options.city_name
@options.out("The file to publish.", type=options.FILE, required=True)
def commit(data: DataSet, out: Path) -> None:
    """Write down the hashes of a sealed data set and of its secret: what is published before the scenes are."""
    found = commitments(data)
    write_json(out, asdict(found))
    rows = ", ".join(f"{split} {sum(counts.values()):,} rows" for split, counts in found.rows.items())
    click.echo(f"{out}: {found.edition}, {rows}, {len(found.files)} files")


@seal.command()
@click.argument("file", type=options.FILE)
@click.option(_SECRET, type=options.FILE, help="The secret, once it is published.")
def check(file: Path, secret: Path | None) -> None:
    """Are the scenes that are here those that were committed to? Exit code 1 where they are not."""
    published = read_typed(Commitments, file, "commitments of a sealed data set")
    found = problems(published, secret)
    for line in found:
        click.echo(line)
    if found:
        raise TsbenchError(f"{published.name}: {len(found)} differences from {file}")
    what = "" if secret is None else ", and the secret"
    click.echo(f"{published.edition}: all {len(published.files)} files are those of {file}{what}")
