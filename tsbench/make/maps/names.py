"""Files of extracts: which they are, what each is called, where the one of a name lies."""

from __future__ import annotations

import bz2
import gzip
import re
from collections.abc import Iterable
from pathlib import Path
from typing import IO
from urllib.parse import unquote, urlsplit

from tsbench.core.errors import InputError

_PACKED = ("", ".gz", ".bz2")
SUFFIXES = (*(kind + packed for kind in (".osm", ".osm.xml", ".xml") for packed in _PACKED), ".osm.pbf", ".pbf")
# Files of OpenStreetMap's that are no extract, and what makes one of them.
CHANGES = "a file of changes, not of roads: apply it to an extract with `osmium apply-changes`"
_HISTORY = "a file of all that ever was: take one day of it with `osmium time-filter`"
_OTHERS = {
    **{f".osc{packed}": CHANGES for packed in _PACKED},
    **{f".osh{kind}": _HISTORY for kind in (*_PACKED, ".xml", ".pbf")},
}
_CHUNK, _TAIL = 1 << 20, 256
# Of a file that is called .xml, so much is looked at for OpenStreetMap's own element: others have that ending, too.
_LOOKED_AT = 1 << 16
_ROOT = re.compile(rb"<osm[\s>]")


def ending_of(file: str) -> str:
    """The ending that makes a file an extract, in small letters, or ""."""
    return _longest(file, SUFFIXES)


def extract_name(path: Path) -> str:
    """`nw-moscow` for `.../nw-moscow.osm.gz`, `st.gallen` for `st.gallen.osm`."""
    return path.name[: len(path.name) - len(ending_of(path.name))]


def file_at(name: str, address: str) -> str:
    """What the file of an extract is called here, by the address that it comes from."""
    return name + (ending_of(unquote(urlsplit(address).path)) or ".osm")


def check_file(path: Path) -> None:
    """Can this be an extract? Raises InputError: no file, an empty one, another kind."""
    if not path.exists():
        raise InputError(f"{path}: no such file")
    if not path.is_file():
        raise InputError(f"{path}: not a file; name one OSM extract ({', '.join(SUFFIXES)})")
    if other := _longest(path.name, _OTHERS):
        raise InputError(f"{path}: {_OTHERS[other]}")
    if not ending_of(path.name):
        raise InputError(f"{path}: unknown kind of file; expected one of {', '.join(SUFFIXES)}")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: the file is empty (0 bytes)")


def extracts_in(folder: Path, name: str | None = None) -> dict[str, Path]:
    """The extracts of a folder by name, sorted; of one name where it is given. Other files do not matter.

    Raises InputError where two files are one extract, or would be where file names have no small letters.
    """
    found: dict[str, list[Path]] = {}
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        known = extract_name(path).casefold()
        if (name is None or known == name.casefold()) and _is_extract(path):
            found.setdefault(known, []).append(path)
    twice = next((paths for paths in found.values() if len(paths) > 1), None)
    if twice is not None:
        told = " and ".join(path.name for path in twice)
        raise InputError(f"{folder}: {told} are one extract by their names: rename or remove all but one")
    return {extract_name(path): path for _, (path,) in sorted(found.items())}


def opened_xml(path: Path) -> IO[bytes] | gzip.GzipFile:
    """The XML of an extract, unpacked."""
    ending = ending_of(path.name)
    if ending.endswith(".gz"):
        return gzip.open(path)
    return bz2.open(path) if ending.endswith(".bz2") else path.open("rb")


def occurs(pattern: re.Pattern[bytes], path: Path) -> bool:
    """Does a pattern of at most 256 bytes match in the XML of an extract?"""
    tail = b""
    with opened_xml(path) as stream:
        while chunk := stream.read(_CHUNK):
            if pattern.search(tail + chunk):
                return True
            tail = chunk[-_TAIL:]
    return False


def _is_extract(path: Path) -> bool:
    """No hidden file (`._town.osm` is what a Mac adds to town.osm), no folder, no XML of something else."""
    ending = ending_of(path.name)
    if path.name.startswith(".") or not ending or not path.is_file():
        return False
    if not ending.startswith(".xml"):
        return True
    try:
        with opened_xml(path) as stream:
            return _ROOT.search(stream.read(_LOOKED_AT)) is not None
    except (OSError, EOFError):
        return False


def _longest(file: str, endings: Iterable[str]) -> str:
    return max((e for e in endings if file.lower().endswith(e)), key=len, default="")
