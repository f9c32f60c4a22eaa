"""Gets the roads of a box or an outline from Overpass, OpenStreetMap's query service (https://wiki.openstreetmap.org/wiki/Overpass_API)."""

from __future__ import annotations

import gzip
import http.client
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path

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
