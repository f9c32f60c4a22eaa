"""`tsbench signs`: the sign catalogue in words and pictures."""

from pathlib import Path

import click
from rich.console import Console

from tsbench.cli import options
from tsbench.cli.console import show_analysis
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.countries import Country, load_countries, write_csv
from tsbench.signs.listing import countries_table, country_table, sign_page, sign_table


@click.group()
def signs() -> None:
    """Traffic signs: list them, show one, draw them all."""


@signs.command("list")
def list_signs() -> None:
    """Print all signs with their scenario types."""
    Console().print(sign_table(DataSet.in_use().catalog))


@signs.command("show")
@click.argument("code")
def show_sign(code: str) -> None:
    """Print what the catalogue says about the sign CODE, such as 3.24."""
    Console().print(sign_page(DataSet.in_use().catalog.sign(code)))


@signs.command("pages")
@options.types
@options.out("Folder for pages and pictures.", type=options.FOLDER, required=True)
def write_pages(types: tuple[str, ...], out: Path) -> None:
    """Write a page for each scenario type: law, rule, a violation and an obedient pass of the same scene."""
    from tsbench.make.pages.sign_pages import PageMaker

    data = DataSet.in_use()
    maker = PageMaker(data, out)
    for name in options.types_of(data, types) or maker.types:
        click.echo(str(maker.write(name)))
    click.echo(str(maker.write_index()))


@signs.command("sheet")
@options.out("PNG file to write.", type=options.FILE, required=True)
@options.caption_country
def draw_sheet(out: Path, country: Country | None) -> None:
    """Draw all plates by group on one page."""
    from tsbench.signs.sheet import save_sheet  # Pillow and the renderer only where pictures are drawn

    save_sheet(DataSet.in_use().catalog, out, country)
    click.echo(str(out))


@signs.command("equivalents")
@options.country("Only this country, sign by sign.")
@click.option("--csv", "path", type=options.FILE, metavar="FILE", help="Also write every entry to this file.")
@options.out("Also write it as CSV, LaTeX and Markdown.", type=options.FOLDER)
def show_equivalents(country: Country | None, path: Path | None, out: Path | None) -> None:
    """Print how many signs each country has an equivalent of, or one country's own codes."""
    catalog, countries = DataSet.in_use().catalog, load_countries() if country is None else (country,)
    table = countries_table(countries) if country is None else country_table(catalog, country)
    Console().print(table)
    if path is not None:
        write_csv(catalog, countries, path)
        click.echo(str(path))
    if out is not None:
        from tsbench.make.pages.sign_pages import countries_analysis, country_analysis

        of_one = None if country is None else country_analysis(catalog, country)
        show_analysis(of_one or countries_analysis(countries), out, printed=False)
