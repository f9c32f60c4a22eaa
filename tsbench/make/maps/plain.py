"""A small road network as SUMO's *plain* elements: what a crop is cut into and what a scene edits.

Networks of whole extracts are read from netconvert's files of the same kind, without connections: crops get their own.

Source: SUMO documentation, "Networks / PlainXML".
"""

from __future__ import annotations

import gzip
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import IO

from lxml import etree

from tsbench.geometry.polyline import Polyline
from tsbench.make.maps.extracts import opened_xml
from tsbench.make.maps.road_tags import WIDTH_RANGE_M
from tsbench.scenarios.data_set import DataSet

Point = tuple[float, float]
DEFAULT_WIDTH_M = 3.25
# The OSM nodes that an id of a junction is made of; an id of an editor's own is below zero.
_NUMBERS = re.compile(r"-?\d+")


@dataclass(frozen=True, slots=True)
class PlainNode:
    """A node: position in metres in the crop's own frame (x east, y north).

    right_of_way: SUMO's `rightOfWay`, "" = default, "edgePriority" = by the priorities of the edges alone.
    """

    id: str
    x: float
    y: float
    type: str = "priority"
    right_of_way: str = ""


@dataclass(frozen=True, slots=True)
class PlainLane:
    """What differs on one lane (index 0: rightmost). `allow`: SUMO vClass list, "" = default."""

    index: int
    width: float | None = None
    allow: str = ""


@dataclass(frozen=True, slots=True)
class PlainEdge:
    """A directed edge; `shape` includes both end points, metres; `speed` m/s; `priority` as SUMO's."""

    id: str
    source: str
    target: str
    num_lanes: int
    speed: float
    priority: int
    shape: tuple[Point, ...]
    type: str = ""
    name: str = ""
    width: float | None = None
    spread: str = "right"
    allow: str = ""
    disallow: str = ""
    lanes: tuple[PlainLane, ...] = ()


@dataclass(frozen=True, slots=True)
class PlainConnection:
    """A lane-to-lane connection. An edge without any has none given: netconvert computes them."""

    source: str
    target: str
    from_lane: int
    to_lane: int


@dataclass(frozen=True, slots=True)
class PlainCrossing:
    """A pedestrian crossing over `edges` at `node`; width in metres."""

    node: str
    edges: tuple[str, ...]
    width: float = 4.0


@dataclass(frozen=True)
class PlainNet:
    """The elements of one small network. `origin`: (lat, lon) of (0, 0); ids are those of the source network.
    `data`: whose type map it is built with.

    `roundabouts`: the edge ids of each ring in driving order (netconvert then gives the ring right of way).
    """

    nodes: tuple[PlainNode, ...]
    edges: tuple[PlainEdge, ...]
    connections: tuple[PlainConnection, ...]
    crossings: tuple[PlainCrossing, ...] = ()
    roundabouts: tuple[tuple[str, ...], ...] = ()
    origin: Point = (0.0, 0.0)
    attributes: dict[str, str] = field(default_factory=dict)
    data: DataSet = field(default_factory=DataSet)


def split_edge(plain: PlainNet, edge_id: str, cuts: Sequence[float]) -> tuple[PlainNet, tuple[str, ...]]:
    """Cut an edge at arc lengths (m), lane for lane; returns the net and the parts' ids `<edge>.0`, `.1`, ..."""
    edge = next(e for e in plain.edges if e.id == edge_id)
    line = Polyline(edge.shape)
    ends = [0.0, *cuts, line.length]
    parts, nodes, links = [], [], []
    for k, (a, b) in enumerate(pairwise(ends)):
        shape = tuple((float(x), float(y)) for x, y in line.slice(a, b).points)
        source = edge.source if k == 0 else f"{edge_id}.cut{k}"
        target = edge.target if b == line.length else f"{edge_id}.cut{k + 1}"
        parts.append(replace(edge, id=f"{edge_id}.{k}", source=source, target=target, shape=shape))
        if k:
            x, y = line.point_at(a)
            nodes.append(PlainNode(f"{edge_id}.cut{k}", x, y))
            links += [PlainConnection(f"{edge_id}.{k - 1}", f"{edge_id}.{k}", i, i) for i in range(edge.num_lanes)]
    edges: list[PlainEdge] = [e for e in plain.edges if e.id != edge_id] + parts
    connections = [c for c in plain.connections if edge_id not in (c.source, c.target)]
    net = replace(plain, nodes=(*plain.nodes, *nodes), edges=tuple(edges), connections=(*connections, *links))
    return net, tuple(p.id for p in parts)


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
