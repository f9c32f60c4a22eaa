"""Files of extracts: which they are, what each is called, where the one of a name lies.

Roads of a box or an outline come from Overpass, OpenStreetMap's query service
(https://wiki.openstreetmap.org/wiki/Overpass_API).
"""

from __future__ import annotations

import bz2
import gzip
import http.client
import re
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterable
from pathlib import Path
from typing import IO
from urllib.parse import unquote, urlsplit

from lxml import etree

import tsbench
from tsbench.core.errors import InputError
from tsbench.core.files import sha256_of, write_atomic
from tsbench.core.xmlfile import parse
from tsbench.make.maps.road_tags import CAR_ROADS

Box = tuple[float, float, float, float]  # west, south, east, north, degrees
Outline = tuple[tuple[float, float], ...]  # corners, (longitude, latitude), degrees; the first is not repeated
SERVER = "https://overpass-api.de/api/interpreter"
_MOST_DEGREES, _MOST_BYTES, _TIMEOUT_S = 1.5, 1 << 30, 900
# What a server answers that has too much to do; the same question is answered later.
_BUSY = {429, 503, 504}


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


def parse_box(text: str) -> Box:
    """`west,south,east,north` in degrees. Raises InputError."""
    try:
        west, south, east, north = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            f"--bbox {text}: expected west,south,east,north in degrees, e.g. 37.60,55.74,37.64,55.76"
        ) from None
    if not (-180 <= west < east <= 180 and -90 <= south < north <= 90):
        raise InputError(f"--bbox {text}: west must be below east and south below north, in degrees")
    if east - west > _MOST_DEGREES or north - south > _MOST_DEGREES:
        raise InputError(f"--bbox {text}: larger than {_MOST_DEGREES} degrees; Overpass would refuse it")
    return west, south, east, north


def check_outline(place: str, outline: Outline) -> None:
    """Raises InputError for a place that is too large to be asked for."""
    for values in zip(*outline, strict=True):
        if max(values) - min(values) > _MOST_DEGREES:
            raise InputError(f"--place {place}: larger than {_MOST_DEGREES} degrees; Overpass would refuse it")


def query(area: Box | Outline, date: str | None = None, ground: bool = False) -> str:
    """What is asked: roads for cars with nodes and turn restrictions, now or as they were on a date (YYYY-MM-DD).

    ground: also buildings, greenery and water, which only pictures use.
    """
    when = f'[date:"{date}T00:00:00Z"]' if date else ""
    roads, where = "|".join(sorted(CAR_ROADS)), _where(area)
    asked = "".join(f'wr["{key}"]{where};' for key in ("building", "landuse", "leisure", "natural", "waterway"))
    surfaces, more = (f"({asked})->.ground;", ".ground; .ground >;") if ground else ("", "")
    return (
        f"[out:xml][timeout:{_TIMEOUT_S}]{when};"
        f'way["highway"~"^({roads})$"]{where}->.roads;'
        f'{surfaces}(.roads; node(w.roads); relation(bw.roads)["type"="restriction"];{more});out body;'
    )


def _where(area: Box | Outline) -> str:
    """The filter of a question."""
    corners = [corner for corner in area if isinstance(corner, tuple)]
    if corners:
        return '(poly:"' + " ".join(f"{lat:.5f} {lon:.5f}" for lon, lat in corners) + '")'
    west, south, east, north = area
    return f"({south:g},{west:g},{north:g},{east:g})"


def address(area: Box | Outline, date: str | None = None, server: str = SERVER, ground: bool = False) -> str:
    """The same question as an address, which any program that fetches files can ask."""
    return f"{server}?{urllib.parse.urlencode({'data': query(area, date, ground)})}"


def fetch_extract(path: Path, question: str) -> str:
    """Write what `address` gives to `path`, .osm.gz; its SHA-256 (hex).

    The server's own remarks and the hour of its answer are left out: the same roads are the same bytes. Raises
    InputError: no server, a busy one, an answer that it broke off, or no roads.
    """
    server = question.split("?")[0]
    root = parse(_answer(question, server), path, "osm", "answer of Overpass")
    remark = root.find("remark")
    if remark is not None:
        raise InputError(f"{server}: broke its answer off: {' '.join((remark.text or '').split())}")
    if root.find("way") is None:
        raise InputError(f"{server}: there is no road for cars in the box that it was asked for")
    for element in (*root.findall("note"), *root.findall("meta")):
        root.remove(element)
    write_atomic(path, gzip.compress(etree.tostring(root, encoding="UTF-8", xml_declaration=True), mtime=0))
    return sha256_of(path)


def is_address(text: str) -> bool:
    """Is it a question to Overpass, as `address` makes them, and not a file?"""
    return "?data=" in text


def _answer(question: str, server: str) -> bytes:
    request = urllib.request.Request(question, headers={"User-Agent": f"tsbench/{tsbench.__version__}"})
    try:
        with urllib.request.urlopen(request, timeout=_TIMEOUT_S) as answer:
            data: bytes = answer.read(_MOST_BYTES + 1)
    except urllib.error.HTTPError as problem:
        later = "; it is busy: try again later, or another one with --server" if problem.code in _BUSY else ""
        raise InputError(f"{server}: answers {problem.code} {problem.reason}{later}") from None
    except (OSError, http.client.HTTPException, ValueError) as problem:
        raise InputError(f"{server}: cannot be asked ({problem})") from None
    if len(data) > _MOST_BYTES:
        raise InputError(f"{server}: answers more than {_MOST_BYTES >> 20} MiB: take a smaller --bbox")
    return data


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
