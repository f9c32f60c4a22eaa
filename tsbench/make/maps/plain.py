"""A small road network as SUMO's *plain* elements: what a crop is cut into and what a scene edits.

Source: SUMO documentation, "Networks / PlainXML".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

from tsbench.geometry.polyline import Polyline

Point = tuple[float, float]


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
    """What differs on one lane (index 0: rightmost). `allow`/`disallow`: SUMO vClass lists, "" = default."""

    index: int
    width: float | None = None
    speed: float | None = None
    allow: str = ""
    disallow: str = ""


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
    priority: bool = True


@dataclass(frozen=True)
class PlainNet:
    """The elements of one small network. `origin`: (lat, lon) of (0, 0); ids are those of the source network.

    `roundabouts`: the edge ids of each ring in driving order (netconvert then gives the ring right of way).
    """

    nodes: tuple[PlainNode, ...]
    edges: tuple[PlainEdge, ...]
    connections: tuple[PlainConnection, ...]
    crossings: tuple[PlainCrossing, ...] = ()
    roundabouts: tuple[tuple[str, ...], ...] = ()
    origin: Point = (0.0, 0.0)
    attributes: dict[str, str] = field(default_factory=dict)


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
