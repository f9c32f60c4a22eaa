"""Files from a folder or an http(s) address, put in place only when they are the ones that were asked for."""

from __future__ import annotations

import hashlib
import http.client
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from tsbench.core.data_manifest import DataFile, DataSet
from tsbench.core.errors import InputError
from tsbench.core.files import replacing
from tsbench.core.paths import data_file

_BLOCK = 1 << 20
_TIMEOUT_S = 60.0


def fetch_set(data: DataSet, source: str, report: Callable[[DataFile], None]) -> int:
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
