"""Reads netconvert's plain XML of a whole extract. Not its connections: crops get their own."""

from __future__ import annotations

import gzip
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import IO

from lxml import etree

from tsbench.make.maps.names import opened_xml
from tsbench.make.maps.plausible import WIDTH_RANGE_M

DEFAULT_WIDTH_M = 3.25
# The OSM nodes that an id of a junction is made of; an id of an editor's own is below zero.
_NUMBERS = re.compile(r"-?\d+")


@dataclass(frozen=True, slots=True)
class ParsedEdge:
    """One directed edge; `line` (metres, tail to head) is its middle if `centred`, else its left side.

    `osm_ids`: the OSM ways it was made of.
    """

    id: str
    tail: str
    head: str
    lanes: int
    priority: int
    speed: float
    width: float
    road_class: str
    street: str
    centred: bool
    osm_ids: list[int]
    line: list[tuple[float, float]]


def elements(file: Path | IO[bytes] | gzip.GzipFile, tag: str | Sequence[str] | None) -> Iterator[etree._Element]:
    """The elements called `tag`, or so, or all, one by one, the tree behind them freed."""
    for _, element in etree.iterparse(
        str(file) if isinstance(file, Path) else file,
        events=("end",),
        tag=tag,
        resolve_entities=False,
        no_network=True,
        huge_tree=True,
    ):
        yield element
        element.clear()
        while element.getprevious() is not None:
            del element.getparent()[0]


def parse_nodes(path: Path) -> dict[str, tuple[float, float]]:
    """Place of each node, in the order of the ids."""
    nodes = {e.get("id", ""): (float(e.attrib["x"]), float(e.attrib["y"])) for e in elements(path, "node")}
    return dict(sorted(nodes.items()))


def parse_projection(path: Path) -> str:
    """The projection of a file of nodes, as PROJ writes it; "" where it has none."""
    return next((e.get("projParameter", "") for e in elements(path, "location")), "")


@cache
def class_speeds(path: Path) -> dict[str, float]:
    """The limit of each road class of a type map, m/s."""
    return {str(e.attrib["id"]): float(e.attrib["speed"]) for e in elements(path, "type")}


def parse_edges(path: Path, nodes: dict[str, tuple[float, float]]) -> list[ParsedEdge]:
    """All edges, in the order of the ids."""
    return sorted((_edge(e, nodes) for e in elements(path, "edge") if "from" in e.attrib), key=lambda e: e.id)


def parse_roundabouts(path: Path) -> list[list[str]]:
    """Edge ids of each roundabout, in no order along the ring."""
    return sorted(e.get("edges", "").split() for e in elements(path, "roundabout"))


def origins_and_junctions(built: Iterable[Path]) -> tuple[set[int], dict[int, str]]:
    """OSM ways that edges were made of, and the junction of each OSM node that is one or part of one.

    built: a network (.gz or not), or files of nodes and edges.
    """
    ways: set[int] = set()
    junctions: dict[int, str] = {}
    for path in built:
        with opened_xml(path) as stream:
            for element in elements(stream, ("param", "node", "junction")):
                if element.tag != "param":
                    name = element.get("id", "")
                    junctions |= dict.fromkeys((int(node) for node in _NUMBERS.findall(name)), name)
                elif element.get("key") == "origId":
                    ways.update(int(way) for way in element.get("value", "").split())
    return ways, junctions


def _edge(element: etree._Element, nodes: dict[str, tuple[float, float]]) -> ParsedEdge:
    get = element.get
    tail, head = get("from", ""), get("to", "")
    shape = get("shape")
    line = (
        [(float(x), float(y)) for x, y in (point.split(",")[:2] for point in shape.split())]
        if shape
        else [nodes[tail], nodes[head]]
    )
    origins = {int(p) for e in element.iter("param") if e.get("key") == "origId" for p in e.get("value", "").split()}
    widths = [float(lane.attrib["width"]) for lane in element.iter("lane") if "width" in lane.attrib]
    width = float(get("width", max(widths, default=DEFAULT_WIDTH_M)))
    return ParsedEdge(
        id=get("id", ""),
        tail=tail,
        head=head,
        lanes=int(element.attrib["numLanes"]),
        priority=int(element.attrib["priority"]),
        speed=float(element.attrib["speed"]),
        width=width if WIDTH_RANGE_M[0] <= width <= WIDTH_RANGE_M[1] else DEFAULT_WIDTH_M,
        road_class=get("type", "").partition("|")[0].removeprefix("highway."),
        street=get("name", ""),
        centred=get("spreadType", "right") == "center",
        osm_ids=sorted(origins),
        line=line,
    )
