"""`tsbench signs`: the sign catalogue in words and pictures."""

from collections.abc import Sequence
from pathlib import Path

import click
from rich.console import Console

from tsbench.cli import options
from tsbench.cli.console import show_analysis
from tsbench.report.analyses.analysis import Analysis, Row, Table
from tsbench.report.analyses.columns import count_columns, number_columns, text_columns
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.catalog import Catalog, load_catalog
from tsbench.signs.countries import Country, load_countries, write_csv
from tsbench.signs.listing import countries_table, country_table, sign_page, sign_table


@click.group()
def signs() -> None:
    """Traffic signs: list them, show one, draw them all."""


@signs.command("list")
@options.city
def list_signs(data: DataSet) -> None:
    """Print all signs with their scenario types."""
    Console().print(sign_table(data.catalog))


@signs.command("show")
@click.argument("code", shell_complete=options.completed_of(lambda data: data.catalog.signs))
@options.city
def show_sign(code: str, data: DataSet) -> None:
    """Print what the catalogue says about the sign CODE, such as 3.24."""
    Console().print(sign_page(data.catalog.sign(code)))


@signs.command("sheet")
@options.out("PNG file to write.", type=options.FILE, required=True)
@options.city
@options.caption_country
def draw_sheet(out: Path, data: DataSet, country: Country | None) -> None:
    """Draw all plates by group on one page."""
    from tsbench.signs.plates import save_sheet  # Pillow and the renderer only where pictures are drawn

    save_sheet(data.artwork(country), out)
    click.echo(str(out))


@signs.command("equivalents")
@options.country("Only this country, sign by sign.")
@click.option("--csv", "path", type=options.FILE, metavar="FILE", help="Also write every entry to this file.")
@options.out("Also write it as CSV, LaTeX and Markdown.", type=options.FOLDER)
def show_equivalents(country: Country | None, path: Path | None, out: Path | None) -> None:
    """Print how many signs each country has an equivalent of, or one country's own codes."""
    catalog, countries = load_catalog(), load_countries() if country is None else (country,)
    table = countries_table(countries) if country is None else country_table(catalog, country)
    Console().print(table)
    if path is not None:
        write_csv(catalog, countries, path)
        click.echo(str(path))
    if out is not None:
        of_one = None if country is None else _country_analysis(catalog, country)
        show_analysis(of_one or _countries_analysis(countries), out, printed=False)


def _countries_analysis(countries: Sequence[Country]) -> Analysis:
    columns = (
        *text_columns("country", "name", "numbering"),
        *count_columns(equivalents="with\nequivalent", signs="signs"),
        *number_columns(0, share="share\n%", published="published\n%"),
        *count_columns("checked"),
    )
    rows = tuple(
        Row((c.code, c.name_en, c.numbering, c.count, c.known, c.percent, c.published_percent, c.checked))
        for c in countries
    )
    notes = (
        "with equivalent: signs by which the country tells a driver the same; published: the share that the reference "
        "quotes; checked: entries found in a source",
    )
    title = f"Country equivalents of {len(countries[0].equivalents)} signs"
    return Analysis("countries", title, "", Table(columns, rows, 3), notes)


def _country_analysis(catalog: Catalog, country: Country) -> Analysis:
    keys = ("sign", "name", "equivalent", "source", "remark")
    rows = []
    for sign, entry in country.equivalents.items():
        checked, note = "checked" if entry.checked else "memory", entry.reason or entry.note or ""
        rows.append(Row((sign, catalog.sign(sign).name_en, entry.code, checked, note)))
    title = f"{country.name_en}: {country.count} of {country.known} signs have an equivalent"
    columns = text_columns(*keys)
    return Analysis(f"country-{country.code}", title, "", Table(columns, tuple(rows), 5), (country.numbering,))
