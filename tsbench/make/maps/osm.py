"""Reads OSM extracts: checks them, writes them as plain XML for netconvert, finds the traffic signals.

pyosmium does the reading (XML, .gz, .bz2 and .pbf); what it objects to becomes one line with file and place.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import osmium

from tsbench.core.errors import InputError
from tsbench.make.maps.names import check_file
from tsbench.make.maps.osm_objects import FARTHEST_KM, contents_of, not_whole
from tsbench.make.maps.road_tags import CAR_ROADS, ClosedRoads, SetAside, closed_by, for_cars, some
from tsbench.make.maps.utm import Floats, UtmFrame


@dataclass(frozen=True)
class ExtractFacts:
    """What an extract tells: sizes and the traffic signals' places, (n, 2) degrees: lat, lon.

    road_ends: first and last node of each road for cars, by way. zone: of UTM, that netconvert is told. notes: a line
    for each thing that was not taken as it is. warnings: what netconvert said besides, a line of each kind.
    """

    nodes: int
    ways: int
    signals: Floats
    road_ends: dict[int, tuple[int, int]]
    zone: int
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def roads(self) -> int:
        return len(self.road_ends)


def read_extract(path: Path, plain_xml: Path, in_mirror: bool = False) -> ExtractFacts:
    """Check an extract and write it as uncompressed OSM XML to `plain_xml`: nodes, then ways, then relations.

    What is deleted, an older version, a road that is closed to cars or leaps across the map is left out, and so are
    tags that no road can have. in_mirror: it is written as its image in a mirror on the meridian of its zone; what is
    told is of the extract as it is.

    Raises InputError if it is missing, empty, truncated, not OSM, or has no road for cars.
    """
    check_file(path)
    contents = contents_of(path)
    meridian = UtmFrame(contents.places.zone).meridian
    nodes = ways = 0
    road_ends: dict[int, tuple[int, int]] = {}
    signals: list[tuple[float, float]] = []
    aside, closed, leaping = SetAside(), ClosedRoads(), list[str]()
    try:
        with osmium.SimpleWriter(str(plain_xml), overwrite=True) as writer:
            for entity in contents.objects():
                highway, tags = entity.tags.get("highway"), None
                if entity.is_node():
                    nodes += 1
                    if highway == "traffic_signals":
                        signals.append((entity.location.lat, entity.location.lon))
                elif entity.is_way():
                    ways += 1
                    if highway in CAR_ROADS:
                        told = {tag.k: tag.v for tag in entity.tags}
                        if reason := closed_by(told):
                            closed.add(entity.id, reason)
                            continue
                        refs = [node.ref for node in entity.nodes]
                        if contents.places.leaps(refs):
                            leaping.append(f"way {entity.id}")
                            continue
                        if len(refs) > 1:
                            road_ends[entity.id] = (refs[0], refs[-1])
                        believed = aside.from_road(entity.id, for_cars(told))
                        tags = believed if believed != told else None
                if in_mirror:
                    writer.add(mirrored(entity, meridian, tags))
                else:
                    writer.add(entity if tags is None else entity.replace(tags=tags))
    except (RuntimeError, ValueError, osmium.InvalidLocationError) as broken:
        raise not_whole(path, broken, nodes, ways) from broken
    far = (
        f"ways left out, two neighbouring nodes more than {FARTHEST_KM:g} km apart: {some(leaping)}" if leaping else ""
    )
    if not road_ends:
        why = (
            f"all {closed.count} roads are closed to cars: {closed.reasons}"
            if closed.found
            else far or "none with a car `highway` tag"
        )
        raise InputError(f"{path}: no road for cars in it ({nodes} nodes, {ways} ways, {why})")
    if contents.places.zone == 0:
        raise InputError(
            f"{path}: no road for cars in it has a place ({len(road_ends)} roads, but no nodes): cut it out again with "
            "`osmium extract`, whose ways are complete"
        )
    notes = (*contents.lines, *closed.lines(), *((far,) if far else ()), *aside.lines())
    return ExtractFacts(nodes, ways, np.array(signals, float).reshape(-1, 2), road_ends, contents.places.zone, notes)


_SWAPPED = {"left": "right", "right": "left"}
# In keys: parking:left:orientation. In values: sharp_left, no_left_turn, right_of:1, through;slight_right.
_WORD = re.compile(r"(?<![A-Za-z])(left|right)(?![A-Za-z])")
# Values of these are names, addresses or remarks, in which left and right are words.
_TEXT = re.compile(
    r"(name|note|description|fixme|addr|ref|operator|website|source|wikipedia|wikidata|destination|comment|inscription)(:|$)"
)
# One value for each lane, from left to right: turn:lanes, change:lanes:forward.
_LANES = re.compile(r"(^|:)lanes(:forward|:backward)?$")
_COUNT = re.compile(r"\d+(\.\d+)?")
# Which line of the way is drawn, counted in lanes: its image would need to know their number.
_DROPPED = re.compile(r"^placement(:|$)")


def mirrored(entity: Any, meridian: int, tags: Mapping[str, str] | None = None) -> Any:
    """A node, way or relation of pyosmium in the mirror; meridian: degrees east; tags: instead of its own."""
    tags = mirrored_tags(tags.items() if tags is not None else ((tag.k, tag.v) for tag in entity.tags))
    if entity.is_node() and entity.location.valid():
        # In whole units of 1e-7 degrees, so that nothing is lost.
        place = entity.location
        image = (2 * meridian * 10_000_000 - place.x) / 1e7
        return entity.replace(location=(_turned(image), place.lat), tags=tags)
    return entity.replace(tags=tags)


def mirrored_tags(tags: Iterable[tuple[str, str]]) -> dict[str, str]:
    """Tags of the image."""
    return {_words(key): _value(key, value) for key, value in tags if not _DROPPED.match(key)}


def _value(key: str, value: str) -> str:
    if _LANES.search(key) and not _COUNT.fullmatch(value):
        value = "|".join(reversed(value.split("|")))
        if _TEXT.match(key):
            return value
    elif _TEXT.match(key):
        return value
    return _words(value)


def _words(text: str) -> str:
    return _WORD.sub(lambda found: _SWAPPED[found[0]], text.replace("_", "\0")).replace("\0", "_")


def _turned(longitude: float) -> float:
    """Between -180 and 180 degrees."""
    return longitude - 360.0 if longitude > 180.0 else longitude + 360.0 if longitude < -180.0 else longitude
