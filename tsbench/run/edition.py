"""Editions: the names that people cite for contracts, and the hashes that were released under them.

`python -m tsbench.run.edition` writes the hashes of this tsbench into `editions.yaml`; a test holds them to it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

import yaml

import tsbench
from tsbench.core.errors import InputError
from tsbench.core.files import write_atomic
from tsbench.run.contract import contract_hash
from tsbench.scenarios.editions import scene_editions
from tsbench.scenarios.table import read_table, splits_there, table_path
from tsbench.signs.catalog import load_catalog

PATH = Path(__file__).with_name("editions.yaml")
LOCAL = "+local"
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
    for edition in editions():
        if any(contract in splits.values() for splits in edition.released.values()):
            return edition.name
    name = told.removesuffix(LOCAL) if isinstance(told, str) and told else editions()[-1].name
    return f"{name}{LOCAL}"


def contract_now(split: str) -> str:
    """The contract hash of a split with this tsbench and its data."""
    return contract_hash(read_table(table_path(split)), load_catalog())


def earlier_splits(root: Path | None = None) -> dict[str, str]:
    """The splits whose scenes are still of an earlier edition, and which: they belong to none that is run here."""
    return {split: name for split, name in scene_editions(root).items() if name != editions()[-1].name}


def release() -> Mapping[str, str]:
    """Write the contracts of this tsbench down as those of its version; returns them by split."""
    *older, last = editions()
    now = {split: contract_now(split) for split in splits_there() if split not in earlier_splits()}
    newest = replace(last, released={**last.released, tsbench.__version__: now})
    text = yaml.safe_dump(
        [asdict(edition) for edition in (*older, newest)], sort_keys=False, allow_unicode=True, width=120
    )
    write_atomic(PATH, f"{_HEAD}{text}".encode())
    return now


if __name__ == "__main__":
    try:
        for name, contract in release().items():
            print(f"{name} {contract}")
    except InputError as problem:
        raise SystemExit(f"error: {problem}") from None
