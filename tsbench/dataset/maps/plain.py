"""A small road network as SUMO's *plain* elements: what a crop is cut into and what a scene edits.

Source: SUMO documentation, "Networks / PlainXML".
"""

from __future__ import annotations

from dataclasses import dataclass, field

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
