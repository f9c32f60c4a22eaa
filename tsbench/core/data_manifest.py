"""Which files of data there are, in sets that are fetched as one: `data_manifest.json`, with sizes and hashes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.core.files import sha256_of

SCHEMA_VERSION = 1
MANIFEST = Path(__file__).with_name("data_manifest.json")


@dataclass(frozen=True, slots=True)
class DataFile:
    """name: relative to a data root, with slashes. size: bytes. sha256: hex, of the file as it is on disk."""

    name: str
    size: int
    sha256: str

    def is_at(self, path: Path) -> bool:
        return path.is_file() and path.stat().st_size == self.size and sha256_of(path) == self.sha256


@dataclass(frozen=True, slots=True)
class DataSet:
    name: str
    about: str
    files: tuple[DataFile, ...]

    @property
    def size(self) -> int:
        return sum(file.size for file in self.files)


@cache
def data_sets() -> Mapping[str, DataSet]:
    told = json.loads(MANIFEST.read_text(encoding="utf-8"))
    if told["schema_version"] != SCHEMA_VERSION:
        raise InputError(f"{MANIFEST}: schema version {told['schema_version']}, expected {SCHEMA_VERSION}")
    return {
        name: DataSet(name, entry["about"], tuple(DataFile(*file) for file in entry["files"]))
        for name, entry in told["sets"].items()
    }


def data_set(name: str) -> DataSet:
    """The set of a name. Raises InputError where there is none."""
    sets = data_sets()
    if name not in sets:
        raise InputError(f"no data of the name {name!r}: there are {', '.join(sets)}")
    return sets[name]
