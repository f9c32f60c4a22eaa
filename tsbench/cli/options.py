"""Options that several commands share."""

import click

from tsbench.signs.countries import Country, load_country


def read_country(_context: click.Context, _parameter: click.Parameter, code: str | None) -> Country | None:
    """The country of a code, None without one."""
    return None if code is None else load_country(code)


jurisdiction_option = click.option(
    "--jurisdiction", "country", metavar="CODE", callback=read_country,
    help="Caption plates with this country's codes, such as de; plates and rules stay as they are.",
)  # fmt: skip
