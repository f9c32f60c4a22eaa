"""Reads OSM extracts: checks them, writes them as plain XML for netconvert, finds the traffic signals.

pyosmium does the reading (XML, .gz, .bz2 and .pbf); what it objects to becomes one line with file and place.

Not all objects of an extract count. Files hold objects that are no more: versions in a history, `visible="false"`,
`action="delete"` of an editor. And Overpass writes ways before their nodes, which netconvert then drops without a word.
Places may be no numbers of degrees, and roads may leap across the map.
"""

from __future__ import annotations

import re
import zlib
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import osmium
from lxml import etree

from tsbench.core.errors import InputError
from tsbench.make.maps.extracts import CHANGES, check_file, ending_of, occurs, opened_xml
from tsbench.make.maps.plain import elements
from tsbench.make.maps.road_tags import CAR_ROADS, ClosedRoads, SetAside, closed_by, for_cars, mirrored, some
from tsbench.make.maps.utm import Floats, UtmFrame, zones_at

_KINDS = ("node", "way", "relation")
_ENTITIES = (osmium.osm.NODE, osmium.osm.WAY, osmium.osm.RELATION)
# What only files of editors and of changes have; most files are not looked at any closer.
_MARKS = re.compile(rb"""<osmChange[\s>]|\baction\s*=\s*["']delete["']""")
_GEOMETRY = re.compile(rb"""<center\s|<nd\s[^<>]*\blat\s*=""")
# What a plain file has within its objects.
_PARTS = ("nd", "member", "tag")
# No two neighbouring nodes of a road are so far apart.
FARTHEST_KM = 50.0
_KM_PER_DEGREE = 111.2
_UNITS = 10_000_000  # of osmium's, in a degree
_UNDEFINED = 2**31 - 1  # a node without a place
_DEGREES = re.compile(r"-?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_MOST = {f"{which}{axis}": most for axis, most in (("lat", 90.0), ("lon", 180.0)) for which in ("", "min", "max")}
Ints = npt.NDArray[np.int64]


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


def osm_file(path: Path) -> Any:
    """The file for pyosmium, which knows endings in small letters and plain OSM XML only."""
    if has_geometry(path):
        return osmium.io.FileBuffer(with_nodes(path), "osm")
    kind, _, packed = ending_of(path.name).rpartition(".")
    return osmium.io.File(str(path), f"osm.{packed}" if kind and packed in ("gz", "bz2") else packed)


@dataclass(frozen=True)
class Contents:
    """The objects of an extract in the order of the file, (n,): kind (0 node, 1 way, 2 relation), and does it count?

    file: for pyosmium. places: of the nodes that count.
    """

    file: Any
    kind: npt.NDArray[np.int8]
    counts: npt.NDArray[np.bool_]
    lines: tuple[str, ...]
    places: Places

    @property
    def in_order(self) -> bool:
        """Nodes before ways before relations, as netconvert reads them."""
        return bool((np.diff(self.kind[self.counts]) >= 0).all())

    @property
    def as_they_are(self) -> bool:
        return self.in_order and bool(self.counts.all())

    def objects(self) -> Iterator[Any]:
        """Those that count, nodes first, then ways, then relations; else in the order of the file."""
        if self.in_order:
            yield from self._those(osmium.osm.NODE | osmium.osm.WAY | osmium.osm.RELATION, self.counts)
        else:
            for kind, entity in enumerate(_ENTITIES):
                yield from self._those(entity, self.counts[self.kind == kind])

    def _those(self, entity: Any, counts: npt.NDArray[np.bool_]) -> Iterator[Any]:
        found = osmium.FileProcessor(self.file, entity)
        for one, counting in zip(found, counts.tolist(), strict=True):
            if counting:
                yield one


def contents_of(path: Path) -> Contents:
    """Look an extract through. Raises InputError: no whole OSM file, a file of changes, an impossible place."""
    kinds, ids, versions, there = array("b"), array("q"), array("q"), array("b")
    x, y = array("i"), array("i")
    try:
        file = osm_file(path)
        for one in osmium.FileProcessor(file, osmium.osm.NODE | osmium.osm.WAY | osmium.osm.RELATION):
            kinds.append(0 if one.is_node() else 1 if one.is_way() else 2)
            ids.append(one.id)
            versions.append(one.version)
            there.append(one.visible)
            if one.is_node():
                x.append(one.location.x)
                y.append(one.location.y)
        marked = _marked_deleted(path)
    except osmium.InvalidLocationError as broken:
        check_places(path)
        raise InputError(f"{path}: a place is no number of degrees ({broken})") from broken
    except (RuntimeError, ValueError, OSError, EOFError, zlib.error, etree.XMLSyntaxError) as broken:
        nodes, ways = kinds.count(0), kinds.count(1)
        raise not_whole(path, broken, nodes, ways) from broken
    kind, number, version = (np.array(one, np.int64) for one in (kinds, ids, versions))
    visible = np.array(there, np.bool_)
    visible[marked] = False
    # The last of each group is its newest: of one version the one that stands later in the file.
    order = np.lexsort((np.arange(len(kind)), version, number, kind))
    same = (np.diff(kind[order]) == 0) & (np.diff(number[order]) == 0)
    newest = np.zeros(len(kind), np.bool_)
    newest[order[np.append(~same, True)] if len(order) else order] = True
    gone = np.flatnonzero(newest & ~visible)
    lines = []
    if len(gone):
        named = [f"{_KINDS[kind[row]]} {number[row]}" for row in gone.tolist()]
        lines.append(f"left out what is deleted: {some(named)}")
    if not newest.all():
        lines.append(f"of objects that stand there more than once the newest counts: {(~newest).sum():,} left out")
    counts = newest & visible
    of_nodes = np.flatnonzero(kind == 0)
    lon, lat = (np.array(one, np.int64) for one in (x, y))
    check_numbers(path, lon, lat)
    nowhere = of_nodes[(lon == 0) & (lat == 0) & counts[of_nodes]]
    if len(nowhere):
        lost = some([f"node {node}" for node in number[nowhere].tolist()])
        lines.append(f"left out what lies at 0, 0 degrees, where no road is: {lost}")
        counts[nowhere] = False
    counting = counts[of_nodes]
    places = places_of(number[of_nodes][counting], lon[counting], lat[counting])
    return Contents(file, kind.astype(np.int8), counts, tuple(lines), places)


def not_whole(path: Path, broken: Exception, nodes: int, ways: int) -> InputError:
    """The line for a file that ends early or is something else."""
    said = " ".join(str(broken).split())
    return InputError(f"{path}: not a whole OSM file ({said}; after {nodes} nodes and {ways} ways)")


def _marked_deleted(path: Path) -> list[int]:
    """Numbers, in the file, of the objects that an editor marked as deleted: pyosmium does not read the mark."""
    if ending_of(path.name).endswith("pbf") or not occurs(_MARKS, path):
        return []
    marked, count, depth = [], 0, 0
    with opened_xml(path) as stream:
        for event, element in etree.iterparse(
            stream, events=("start", "end"), resolve_entities=False, no_network=True, huge_tree=True
        ):
            if event == "start":
                if depth == 0 and element.tag == "osmChange":
                    raise InputError(f"{path}: {CHANGES}")
                if depth == 1 and element.tag in _KINDS:
                    if element.get("action") == "delete":
                        marked.append(count)
                    count += 1
                depth += 1
            else:
                depth -= 1
                if depth == 1:
                    element.clear()
                    while element.getprevious() is not None:
                        del element.getparent()[0]
    return marked


def has_geometry(path: Path) -> bool:
    """Does an extract repeat places in this way?"""
    return not ending_of(path.name).endswith("pbf") and occurs(_GEOMETRY, path)


def with_nodes(path: Path) -> bytes:
    """Its XML as `out body` writes it, then the nodes that stand in its ways only."""
    nodes: set[str | None] = set()
    places: dict[str, etree._Element] = {}
    made = BytesIO()
    with opened_xml(path) as stream, etree.xmlfile(made, encoding="UTF-8") as file, file.element("osm", version="0.6"):
        for element in elements(stream, ("node", "way", "relation")):
            if element.tag == "node":
                nodes.add(element.get("id"))
            for part in list(element):
                if part.tag not in _PARTS:
                    element.remove(part)
                    continue
                del part[:]
                name, lat, lon = (part.get(key) for key in ("ref", "lat", "lon"))
                if part.tag == "nd" and name and lat is not None and lon is not None:
                    places.setdefault(name, etree.Element("node", id=name, lat=lat, lon=lon))
            file.write(element, with_tail=False)
        for name, node in places.items():
            if name not in nodes:
                file.write(node)
    return made.getvalue()


@dataclass(frozen=True)
class Places:
    """Nodes that have a place, sorted by id, (n,): id, and place in 1e-7 degrees."""

    ids: Ints
    lon: Ints
    lat: Ints

    @property
    def zone(self) -> int:
        """The zone of UTM in which most of them lie; 0 where there are none."""
        return int(np.bincount(zones_at(self.lon / _UNITS)).argmax()) if len(self.ids) else 0

    def leaps(self, nodes: list[int]) -> bool:
        """Are two neighbouring nodes of a way more than FARTHEST_KM apart? Nodes without a place do not count."""
        if not len(self.ids):
            return False
        wanted = np.array(nodes, np.int64)
        rows = np.searchsorted(self.ids, wanted).clip(max=len(self.ids) - 1)
        rows = rows[self.ids[rows] == wanted]
        lat, lon = self.lat[rows] / _UNITS, self.lon[rows] / _UNITS
        east = (np.diff(lon) + 180.0) % 360.0 - 180.0
        steps = np.hypot(np.diff(lat), east * np.cos(np.radians(lat[:-1])))
        return bool((steps * _KM_PER_DEGREE > FARTHEST_KM).any())


def places_of(ids: Ints, lon: Ints, lat: Ints) -> Places:
    """Those of nodes, (n,), in 1e-7 degrees, some perhaps without a place."""
    there = np.flatnonzero(lon != _UNDEFINED)
    order = there[np.argsort(ids[there], kind="stable")]
    return Places(ids[order], lon[order], lat[order])


def check_numbers(path: Path, lon: Ints, lat: Ints) -> None:
    """Raises InputError for a place, (n,) in 1e-7 degrees, that is not on Earth or was misread."""
    beyond = (lon != _UNDEFINED) & ((np.abs(lon) > 180 * _UNITS) | (np.abs(lat) > 90 * _UNITS))
    if beyond.any() or (lon == 0).any() or (lat == 0).any():
        check_places(path)
    if beyond.any():
        raise InputError(f"{path}: {beyond.sum():,} nodes lie beyond 90 degrees of latitude or 180 of longitude")


def check_places(path: Path) -> None:
    """Raises InputError for the first place in XML that is no number of degrees: osmium reads 1e400 as 0."""
    if ending_of(path.name).endswith("pbf"):
        return
    with opened_xml(path) as stream:
        for element in elements(stream, None):
            for key, most in _MOST.items():
                value = element.get(key)
                if value is None or (_DEGREES.fullmatch(value) and abs(float(value)) <= most):
                    continue
                which = " ".join(filter(None, (str(element.tag), element.get("id") or element.get("ref"))))
                raise InputError(
                    f"{path}: {which}: {key}={value!r:.40} is no number of degrees from -{most:g} to {most:g}: "
                    "write it with a point, such as 55.75"
                )
