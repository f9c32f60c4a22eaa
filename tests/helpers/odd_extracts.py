"""Extracts that nobody prepared: none of them is a town as the benchmark's are."""

from __future__ import annotations

import gzip
import re
from collections.abc import Callable

from town import EAST, Town, make_town

from tsbench.make.maps.utm import UtmFrame

_HERE = UtmFrame(32)
NORTH, SOUTH = 5_540_000.0, 6_250_000.0


def motorway() -> bytes:
    """Two carriageways and no junction."""
    town = Town()
    town.road([(0, 0), (800, 50), (2500, 80)], "motorway", oneway="yes", lanes="3")
    town.road([(2500, 110), (800, 80), (0, 30)], "motorway", oneway="yes", lanes="3")
    return _xml(town)


def grid(columns: int = 20, rows: int = 25) -> bytes:
    """Streets with a junction at every crossing, columns x rows of them."""
    town = Town()
    for j in range(rows):
        town.road([(120.0 * i, 120.0 * j) for i in range(columns)], "residential")
    for i in range(columns):
        town.road([(120.0 * i, 120.0 * j) for j in range(rows)], "tertiary")
    return _xml(town)


def southern() -> bytes:
    """The tests' town at Sydney's latitude."""
    return make_town().xml(UtmFrame(32, south=True), SOUTH).encode()


def across_the_edge() -> bytes:
    """The tests' town on the meridian where zone 32 ends, a quarter of it beyond."""
    east = _HERE.to_metres(50.0, 12.0)[0].item()
    town = make_town()
    town.nodes = {(x + east - EAST - 450.0, y): number for (x, y), number in town.nodes.items()}
    return _xml(town)


def two_towns() -> bytes:
    """The same town twice, 300 km apart."""
    town = make_town()
    far = make_town()
    offset = len(town.nodes)
    town.nodes |= {(x + 300_000.0, y): n + offset for (x, y), n in far.nodes.items()}
    town.ways += [([n + offset for n in refs], tags) for refs, tags in far.ways]
    return _xml(town)


def footpaths() -> bytes:
    town = Town()
    town.road([(0, 0), (100, 0)], "footway")
    return _xml(town)


def without_nodes() -> bytes:
    """Ways whose nodes were cut away."""
    way = b'<way id="1" version="1"><nd ref="7"/><nd ref="8"/><tag k="highway" v="primary"/></way>'
    return b'<osm version="0.6">' + way + b"</osm>"


def one_node() -> bytes:
    """A road of one point: there is no length in it."""
    town = Town()
    town.road([(0, 0)], "residential")
    return _xml(town)


def half() -> bytes:
    whole = _xml(make_town())
    return whole[: len(whole) // 2]


def half_gzip() -> bytes:
    return gzip.compress(_xml(make_town()))[:-300]


def nonsense_tags() -> bytes:
    """Lanes, speeds and names as people write them."""
    town = make_town()
    odd = ({"maxspeed": "walk"}, {"lanes": "many"}, {"lanes": "-2"}, {"maxspeed": "999999"}, {"lanes": "1.5"},
           {"maxspeed": "0"}, {"width": "0"}, {"oneway": "perhaps"}, {"name": "&lt;b&gt;"}, {"maxspeed": "none"},
           {"lanes:both_ways": "1"}, {"vehicle:lanes": "yes|no"})  # fmt: skip
    for (_, tags), more in zip(town.ways, odd, strict=False):
        tags.update(more)
    return _xml(town)


def decimal_comma() -> bytes:
    """A place as people of half of Europe write numbers."""
    return _xml(make_town()).replace(b'lat="50.', b'lat="50,', 1)


def one_at_null() -> bytes:
    """A node that an editor has no place of."""
    return re.sub(rb'lat="[^"]*" lon="[^"]*"', b'lat="0.0" lon="0.0"', _xml(make_town()), count=1)


def _xml(town: Town) -> bytes:
    return town.xml(_HERE, NORTH).encode()


# By file's name: what stands in it. The others end in a data set.
REFUSED: dict[str, tuple[Callable[[], bytes], str]] = {
    "no-roads.osm": (lambda: b'<?xml version="1.0"?>\n<osm version="0.6"></osm>\n', "no road for cars in it"),
    "footpaths.osm": (footpaths, "no road for cars in it"),
    "without-nodes.osm": (without_nodes, "no road for cars in it has a place (1 roads, but no nodes)"),
    "one-node.osm": (one_node, "no road for cars"),
    "motorway.osm": (motorway, "no map found"),
    "half.osm": (half, "not a whole OSM file"),
    "half-gzip.osm.gz": (half_gzip, "not a whole OSM file"),
    "page.osm": (lambda: b"<html><body>Too many requests</body></html>", "not a whole OSM file"),
    "noise.osm.pbf": (lambda: b"\x00\x01\x02noise" * 50, "not a whole OSM file"),
    "decimal-comma.osm": (decimal_comma, "node 1001: lat='50,"),
    "two-towns.osm": (two_towns, "km apart"),
}
BUILT: dict[str, Callable[[], bytes]] = {
    "southern.osm": southern,
    "edge.osm": across_the_edge,
    "nonsense.osm": nonsense_tags,
    "null.osm": one_at_null,
    "grid.osm": grid,
}
