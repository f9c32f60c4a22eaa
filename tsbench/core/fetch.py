"""Sets of data files as `data_manifest.json` lists them, fetched from a folder or an http(s) address.

A file is put in place only if it has the size and the hash of the manifest.
"""

from __future__ import annotations

import hashlib
import http.client
import json
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import IO

from tsbench.core.errors import InputError
from tsbench.core.files import replacing, sha256_of
from tsbench.core.paths import data_file

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
class DataPart:
    name: str
    about: str
    files: tuple[DataFile, ...]

    @property
    def size(self) -> int:
        return sum(file.size for file in self.files)


@cache
def data_sets() -> Mapping[str, DataPart]:
    told = json.loads(MANIFEST.read_text(encoding="utf-8"))
    if told["schema_version"] != SCHEMA_VERSION:
        raise InputError(f"{MANIFEST}: schema version {told['schema_version']}, expected {SCHEMA_VERSION}")
    return {
        name: DataPart(name, entry["about"], tuple(DataFile(*file) for file in entry["files"]))
        for name, entry in told["sets"].items()
    }


def data_set(name: str) -> DataPart:
    """The set of a name. Raises InputError for an unknown name."""
    sets = data_sets()
    if name not in sets:
        raise InputError(f"no data of the name {name!r}: there are {', '.join(sets)}")
    return sets[name]


_BLOCK = 1 << 20
_TIMEOUT_S = 60.0


def fetch_set(data: DataPart, source: str, report: Callable[[DataFile], None]) -> int:
    """Bring the files of a set that are not here from below `source` (a folder, or an http(s) URL); how many came.

    Files that are there are skipped, so that a broken-off fetch goes on. `report` is told of each file that came.
    Raises InputError: what is wrong with which file; files that came before it stay.
    """
    came = 0
    for file in data.files:
        place = data_file(file.name)
        if file.is_at(place):
            continue
        if place.exists():
            raise InputError(f"{place}: is another file than the {data.name} data's: move it away first")
        name = urllib.parse.quote(file.name) if _is_url(source) else file.name
        fetch_file(f"{source.rstrip('/')}/{name}", file.size, file.sha256, place)
        report(file)
        came += 1
    return came


def fetch_file(source: str, size: int, sha256: str, target: Path) -> None:
    """Copy `source` (a path, or an http(s) URL) to `target`, atomically, if it has this size (bytes) and SHA-256 (hex).

    Never reads more than a block beyond the size. Raises InputError, and then leaves nothing behind.
    """
    try:
        with replacing(target) as part, part.open("wb") as file:
            digest, read = hashlib.sha256(), 0
            with _opened(source) as stream:
                while block := stream.read(min(_BLOCK, size + 1 - read)):
                    read += len(block)
                    if read > size:
                        raise InputError(f"{source}: is larger than the {size} bytes that it should have")
                    digest.update(block)
                    file.write(block)
            if read < size:
                raise InputError(f"{source}: ends after {read} of {size} bytes")
            if digest.hexdigest() != sha256:
                raise InputError(f"{source}: has not the SHA-256 {sha256[:12]}… that it should have")
    except (OSError, http.client.HTTPException, ValueError) as problem:
        raise InputError(f"{source}: cannot be fetched ({problem})") from None


def _is_url(source: str) -> bool:
    return source.startswith(("http://", "https://"))


@contextmanager
def _opened(source: str) -> Iterator[IO[bytes]]:
    if _is_url(source):
        with urllib.request.urlopen(source, timeout=_TIMEOUT_S) as answer:
            yield answer
    else:
        with Path(source).open("rb") as file:
            yield file
