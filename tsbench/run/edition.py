"""Editions: the names that people cite for contracts, and the hashes that were released under them.

`python -m tsbench.run.edition` writes the hashes of this tsbench into `editions.yaml`; a test holds them to it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

import yaml

import tsbench
from tsbench.core.errors import InputError
from tsbench.core.files import write_atomic
from tsbench.core.paths import (
    MIRRORED,
    OWN_CITY,
    SHIPPED_CITIES,
    city_in_use,
    data_file,
    dataset_root,
    using_city,
)
from tsbench.run.contract import contract_hash, mirrored_contract
from tsbench.scenarios.editions import scene_editions
from tsbench.scenarios.table import read_table, splits_there, table_path
from tsbench.signs.catalog import load_catalog

PATH = Path(__file__).with_name("editions.yaml")
LOCAL = "+local"
_OF_CITY = "edition.yaml"  # beside the data of a city
_HEAD = (
    "# Editions, oldest first: docs/editions.md says what each is. released: contract hash of each split, by version\n"
    "# of tsbench. Written by `python -m tsbench.run.edition`; titles by hand.\n"
)


@dataclass(frozen=True)
class Edition:
    """name: as cited, such as "2026.1". title: one line. released: contract by split, by version of tsbench."""

    name: str
    title: str
    released: Mapping[str, Mapping[str, str]]


@cache
def editions() -> tuple[Edition, ...]:
    """All editions, oldest first; the last one is what this tsbench runs."""
    return tuple(Edition(**entry) for entry in yaml.safe_load(PATH.read_text(encoding="utf-8")))


def edition_of(contract: str, told: object = "") -> str:
    """The edition that a contract was released under, else one with "+local": something in it has been changed.

    told: what the run that has this contract says of its edition. It is believed only as far as which one was changed.
    """
    for edition in (*editions(), *built_editions()):
        released = {hash_ for splits in edition.released.values() for hash_ in splits.values()}
        if contract in released:
            return edition.name
        if contract in map(mirrored_contract, released):
            return _mirrored_name(edition.name)
    name = told.removesuffix(LOCAL) if isinstance(told, str) and told else edition_now()
    return f"{name}{LOCAL}"


def _mirrored_name(name: str) -> str:
    own = name in {edition.name for edition in editions()}
    return f"{MIRRORED}{OWN_CITY}-{name}" if own else f"{MIRRORED}{name}"


def edition_now() -> str:
    """The edition that is run here: `2026.2`, of another city `north-bayreuth-2026.2`."""
    city, name = city_in_use(), editions()[-1].name
    return name if city == OWN_CITY else f"{city}-{name}"


def built_editions() -> tuple[Edition, ...]:
    """Those of other cities whose data sets were built here, by city."""
    paths = sorted(data_file("cities/data").glob(f"*/{_OF_CITY}"))
    return tuple(
        Edition(**entry) for path in paths for entry in yaml.safe_load(path.read_text(encoding="utf-8"))
    )


def contract_now(split: str) -> str:
    """The contract hash of a split with this tsbench and its data."""
    return contract_hash(read_table(table_path(split)), load_catalog())


def earlier_splits(root: Path | None = None) -> dict[str, str]:
    """The splits whose scenes are still of an earlier edition, and which: they belong to none that is run here."""
    return {split: name for split, name in scene_editions(root).items() if name != editions()[-1].name}


def release_city(title: str) -> Mapping[str, str]:
    """Write the contracts of the city in use down, with this tsbench and what was built; returns them by split."""
    now = {split: contract_now(split) for split in splits_there()}
    scenes = dict.fromkeys(now, editions()[-1].name)
    write_atomic(dataset_root() / "scenarios" / "editions.yaml", yaml.safe_dump(scenes).encode())
    _write((Edition(edition_now(), title, {tsbench.__version__: now}),), dataset_root() / _OF_CITY)
    return now


def release() -> Mapping[str, str]:
    """Write the contracts of this tsbench down as those of its version; returns them by split."""
    *older, last = editions()
    now = {split: contract_now(split) for split in splits_there() if split not in earlier_splits()}
    newest = replace(last, released={**last.released, tsbench.__version__: now})
    _write((*older, newest), PATH)
    return now


def _write(all_of_them: Sequence[Edition], path: Path) -> None:
    text = yaml.safe_dump(
        [asdict(edition) for edition in all_of_them], sort_keys=False, allow_unicode=True, width=120
    )
    write_atomic(path, f"{_HEAD}{text}".encode())


def shipped_titles() -> dict[str, str]:
    """Cities that are released with tsbench and are here, with the titles of their editions."""
    named = {edition.name: edition.title for edition in built_editions()}
    cities = {city: f"{city}-{editions()[-1].name}" for city in SHIPPED_CITIES}
    return {city: named[name] for city, name in cities.items() if name in named}


if __name__ == "__main__":
    try:
        for name, contract in release().items():
            print(f"{name} {contract}")
        for city, title in shipped_titles().items():
            with using_city(city):
                for name, contract in release_city(title).items():
                    print(f"{city} {name} {contract}")
    except InputError as problem:
        raise SystemExit(f"error: {problem}") from None
