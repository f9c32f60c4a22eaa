"""Which data set is driven where a user names a city: of one with traffic on the left, its mirror's."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.core.paths import MIRRORED, city_in_use, data_file, using_city
from tsbench.core.textfile import read_yaml

# Placements, experts and certificates know the right side only. What keeps to the left is built in a mirror, and driven
# in the mirror of that.
RIGHT, LEFT = "right", "left"


def cities_folder() -> Path:
    """Where cities are described, one file each."""
    return data_file("cities")


def driven_as(name: str, side: str) -> str:
    """The data set that is driven for a city whose traffic keeps to `side`."""
    return MIRRORED + name if side == LEFT else name


def driven_city(name: str) -> str:
    """The data set that is driven where a user names a city; a name that nobody describes stays as it is."""
    with using_city(name):
        path = cities_folder() / f"{name}.yaml"
        described = read_yaml(path, "a city") if path.is_file() else None
    side = described.get("side", RIGHT) if isinstance(described, dict) else RIGHT
    return driven_as(name, side)


def check_driven() -> None:
    """Is the data set in use one whose roads are as they are? Raises InputError for what only stores another."""
    if driven_city(city_in_use()) != city_in_use():
        raise InputError(
            f"TSBENCH_CITY {city_in_use()}: is stored in a mirror; name {driven_city(city_in_use())}, or use --city"
        )


@contextmanager
def driving(city: str | None) -> Iterator[None]:
    """Within it the data set is in use that is driven for a city; None: the one that is in use already.

    Raises InputError where that is none whose roads are as they are.
    """
    with using_city(city_in_use() if city is None else driven_city(city)):
        check_driven()
        yield
