"""Reads OSM extracts: checks them, writes them as plain XML for netconvert, finds the traffic signals.

pyosmium does the reading (XML, .gz, .bz2 and .pbf); what it objects to becomes one line with file and place.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import osmium

from tsbench.core.errors import InputError
from tsbench.dataset.maps.osm_mirror import mirrored
from tsbench.dataset.maps.utm import Floats

SUFFIXES = (".osm", ".osm.gz", ".osm.bz2", ".osm.pbf", ".xml", ".xml.gz", ".xml.bz2", ".pbf")
CAR_ROADS = frozenset(
    f"{road}{link}"
    for road in ("motorway", "trunk", "primary", "secondary", "tertiary")
    for link in ("", "_link")
) | {"unclassified", "residential", "living_street", "road"}


@dataclass(frozen=True)
class ExtractFacts:
    """What one pass over an extract tells: sizes and the traffic signals' places, (n, 2) degrees: lat, lon."""

    nodes: int
    ways: int
    roads: int
    signals: Floats


def extract_name(path: Path) -> str:
    """`nw-moscow` for `.../nw-moscow.osm.gz`."""
    return path.name.split(".", 1)[0]


def read_extract(path: Path, plain_xml: Path, meridian: int | None = None) -> ExtractFacts:
    """Check an extract and write it as uncompressed OSM XML to `plain_xml`.

    meridian: of a mirror (degrees) that it is written in, None for none; what is told is of the extract as it is.

    Raises InputError if it is missing, empty, truncated, not OSM, or has no road for cars.
    """
    _check_file(path)
    nodes = ways = roads = 0
    signals: list[tuple[float, float]] = []
    try:
        with osmium.SimpleWriter(str(plain_xml), overwrite=True) as writer:
            for entity in osmium.FileProcessor(str(path)):
                highway = entity.tags.get("highway")
                if entity.is_node():
                    nodes += 1
                    if highway == "traffic_signals":
                        signals.append((entity.location.lat, entity.location.lon))
                elif entity.is_way():
                    ways += 1
                    roads += highway in CAR_ROADS and len(entity.nodes) > 1
                writer.add(entity if meridian is None else mirrored(entity, meridian))
    except (RuntimeError, ValueError, osmium.InvalidLocationError) as broken:
        place = f"after {nodes} nodes and {ways} ways"
        raise InputError(
            f"{path}: not a whole OSM file ({' '.join(str(broken).split())}; {place})"
        ) from broken
    if roads == 0:
        raise InputError(
            f"{path}: no road for cars in it ({nodes} nodes, {ways} ways, none with a car `highway` tag)"
        )
    if nodes == 0:
        raise InputError(
            f"{path}: no road for cars in it has a place ({roads} roads, but no nodes): cut it out again with "
            "`osmium extract`, whose ways are complete"
        )
    return ExtractFacts(nodes, ways, roads, np.array(signals, float).reshape(-1, 2))


def _check_file(path: Path) -> None:
    if not path.exists():
        raise InputError(f"{path}: no such file")
    if not path.is_file():
        raise InputError(f"{path}: not a file; name one OSM extract ({', '.join(SUFFIXES)})")
    if not path.name.lower().endswith(SUFFIXES):
        raise InputError(f"{path}: unknown kind of file; expected one of {', '.join(SUFFIXES)}")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: the file is empty (0 bytes)")
