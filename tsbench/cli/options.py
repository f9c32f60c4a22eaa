"""Options that several commands share, and how they are read."""

from collections.abc import Callable
from typing import Any

import click

from tsbench.signs.countries import Country, load_country

Option = Callable[[Callable[..., Any]], Callable[..., Any]]


def read_country(_context: click.Context, _parameter: click.Parameter, code: str | None) -> Country | None:
    """The country of a code, None without one."""
    return None if code is None else load_country(code)


jurisdiction_option = click.option(
    "--jurisdiction", "country", metavar="CODE", callback=read_country,
    help="Caption plates with this country's codes, such as de; plates and rules stay as they are.",
)  # fmt: skip


def several(*options: Option) -> Option:
    """Options in the order in which --help lists them."""

    def add(function: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed(options):
            function = option(function)
        return function

    return add


def words_of(text: str) -> tuple[str, ...]:
    """What stands between commas, such as type ids and groups."""
    return tuple(word.strip() for word in text.split(",") if word.strip())
