"""A finished SUMO network (.net.xml, .net.xml.gz) as lanes, connections and junctions.

Our own reader, because monitors and planners need lanes as arrays with arc lengths, indices and internal chains.
Source of the format: SUMO documentation, "Networks / SUMO Road Networks".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from lxml import etree

from tsbench.core.errors import InputError
from tsbench.core.xmlfile import parse, read_plain
from tsbench.geometry.polyline import Array, Polyline
from tsbench.roads.road_map import Crossing, MapConnection, MapEdge, MapJunction, MapLane, RoadMap, lanes_beside

DEFAULT_LANE_WIDTH_M = 3.2
_TOUCH_M = 0.01


@dataclass(frozen=True, slots=True)
class Lane(MapLane):
    """One lane of SUMO's. `index` counts all lanes of the network; `length`: SUMO's own, m; `internal`: on a path."""

    length: float = field(kw_only=True)
    allow: frozenset[str] = field(kw_only=True)
    disallow: frozenset[str] = field(kw_only=True)

    def permits(self, vclass: str) -> bool:
        """May vehicles of this SUMO vClass use the lane?"""
        if self.allow:
            return vclass in self.allow or "all" in self.allow
        return vclass not in self.disallow and "all" not in self.disallow


@dataclass(frozen=True, slots=True)
class Edge(MapEdge):
    """An edge of SUMO's. road_class: its type in SUMO ("highway.primary"), "" = none."""

    priority: int = field(kw_only=True)
    road_class: str = field(default="", kw_only=True)


@dataclass(frozen=True, slots=True)
class Connection(MapConnection):
    """A lane-to-lane connection; `via` are the internal lanes in order; `direction`, `state` as SUMO's.

    yields_to: of each connection with right of way over this one, one of its internal lanes (SUMO's `response`).
    """

    direction: str
    state: str
    yields_to: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True)
class Junction(MapJunction):
    """A junction of SUMO's."""

    type: str = field(kw_only=True)


@dataclass(frozen=True)
class RoadNetwork(RoadMap):
    """All that SUMO knows: for simulation, rules and experts. `outgoing[lane]` = its connections in file order.

    class_speed: the limit of a road by its class alone where the network was made, m/s.
    """

    lanes: tuple[Lane, ...]
    edges: Mapping[str, Edge]
    junctions: Mapping[str, Junction]
    connections: tuple[Connection, ...]
    outgoing: tuple[tuple[Connection, ...], ...]
    crossings: Mapping[str, Crossing] = field(default_factory=dict)
    class_speed: Mapping[str, float] = field(default_factory=dict)

    def expected_speed(self, edge_id: str) -> float:
        """What a driver expects of a road where no plate says otherwise, m/s; its own limit where it has no class."""
        edge = self.edges[edge_id]
        return self.class_speed.get(edge.road_class, self.lanes[edge.lanes[0]].speed)

    @cached_property
    def shown_limits(self) -> tuple[float, ...]:
        """The limit of each lane that planners are shown, by index, m/s: what a road's class lets a driver expect.

        On a junction it is the lower one of the roads that a way joins. SUMO's own limit comes from a plate on
        the real road that is not in the scene: planners and rules must not use it.
        """
        limits = [self.expected_speed(lane.edge) for lane in self.lanes]
        for connection in self.connections:
            lowest = min(limits[connection.from_lane], limits[connection.to_lane])
            for via in connection.via:
                limits[via] = lowest
        return tuple(limits)

    def lane(self, lane_id: str) -> Lane:
        """The lane with this SUMO id."""
        return self.lanes[self.lane_index[lane_id]]

    def edge_lanes(self, edge_id: str) -> tuple[Lane, ...]:
        """Lanes of an edge, from the kerb on."""
        return tuple(self.lanes[i] for i in self.edges[edge_id].lanes)


def _points(text: str) -> Array:
    flat = [[float(v) for v in p.split(",")[:2]] for p in text.split()]
    return np.asarray(flat, dtype=np.float64)


def _line(points: Array, internal: bool) -> Polyline:
    if internal and np.ptp(points, axis=0).max() < 1e-6:
        # netconvert writes internal lanes of no extent where two roads touch: a centimetre keeps them lines.
        points = points[:1] + np.array([[0.0, 0.0], [_TOUCH_M, 0.0]])
    return Polyline(points)


def _classes(text: str | None) -> frozenset[str]:
    return frozenset(text.split()) if text else frozenset()


def _read_edges(root: etree._Element, left_hand: bool) -> tuple[list[Lane], dict[str, Edge]]:
    lanes: list[Lane] = []
    edges: dict[str, Edge] = {}
    for element in root.iterfind("edge"):
        if element.get("function") in ("crossing", "walkingarea", "connector"):
            continue
        internal = element.get("function") == "internal"
        base = len(lanes)
        children = element.findall("lane")
        for k, child in enumerate(children):
            line = _line(_points(str(child.attrib["shape"])), internal)
            lanes.append(
                Lane(
                    index=base + k, id=str(child.attrib["id"]), edge=str(element.attrib["id"]), order=k, line=line,
                    width=float(child.get("width", DEFAULT_LANE_WIDTH_M)), speed=float(child.attrib["speed"]),
                    length=float(child.attrib["length"]), internal=internal,
                    allow=_classes(child.get("allow")), disallow=_classes(child.get("disallow")),
                    **lanes_beside(base + k, k, len(children), left_hand),
                )
            )  # fmt: skip
        edges[str(element.attrib["id"])] = Edge(
            id=str(element.attrib["id"]),
            source=element.get("from", ""),
            target=element.get("to", ""),
            lanes=tuple(range(base, base + len(children))),
            internal=internal,
            priority=int(element.get("priority", -1)),
            road_class=element.get("type", ""),
            length=lanes[base].length if children else 0.0,
        )
    return lanes, edges


def _read_responses(root: etree._Element, index: dict[str, int]) -> dict[int, frozenset[int]]:
    """By internal lane: the internal lanes of the connections with right of way over its own."""
    found = {}
    for junction in root.iterfind("junction"):
        lanes = [index.get(name, -1) for name in junction.get("intLanes", "").split()]
        for request in junction.iterfind("request"):
            # The last character is that of the first connection.
            bits = request.get("response", "")[::-1]
            yields = frozenset(i for i, bit in zip(lanes, bits, strict=False) if bit == "1" and i >= 0)
            found[lanes[int(request.attrib["index"])]] = yields
    return found


def _read_crossings(root: etree._Element) -> dict[str, Crossing]:
    found = {}
    for element in root.iterfind("edge"):
        lane = element.find("lane") if element.get("function") == "crossing" else None
        if lane is not None:
            name = str(element.attrib["id"])
            line = Polyline(_points(str(lane.attrib["shape"])))
            edges = tuple(element.get("crossingEdges", "").split())
            found[name] = Crossing(name, edges, line, float(lane.attrib["width"]))
    return found


def _read_connections(root: etree._Element, edges: dict[str, Edge], index: dict[str, int]) -> list[Connection]:
    responses = _read_responses(root, index)
    inner: dict[int, int] = {}
    outer: list[tuple[int, int, str, str, str]] = []
    for element in root.iterfind("connection"):
        source, target = element.attrib["from"], element.attrib["to"]
        if source not in edges or target not in edges:
            continue
        a = edges[source].lanes[int(element.attrib["fromLane"])]
        b = edges[target].lanes[int(element.attrib["toLane"])]
        via = element.get("via", "")
        if edges[source].internal:
            if via in index:
                inner[a] = index[via]
        else:
            outer.append((a, b, via, element.get("dir", "s"), element.get("state", "M")))
    result = []
    for a, b, via, direction, state in outer:
        chain: list[int] = []
        step = index.get(via, -1)
        while step >= 0 and step not in chain:
            chain.append(step)
            step = inner.get(step, -1)
        yields = next((responses[v] for v in chain if v in responses), frozenset[int]())
        result.append(Connection(a, b, tuple(chain), direction, state, yields))
    return result


def _turn_touching(lanes: list[Lane], connections: list[Connection]) -> None:
    """Give internal lanes of no extent the direction of the lane before them."""
    for connection in connections:
        before = lanes[connection.from_lane].line
        for via in connection.via:
            line = lanes[via].line
            if line.length <= _TOUCH_M * 1.001:
                heading = before.heading_at(before.length)
                step = _TOUCH_M * np.array([np.cos(heading), np.sin(heading)])
                lanes[via] = replace(lanes[via], line=Polyline([line.points[0], line.points[0] + step]))


def read_network(path: Path, content: bytes | None = None) -> RoadNetwork:
    """Read a network, from its uncompressed `content` where that is at hand.

    Raises InputError (one line: file, place, problem) for any other content.
    """
    root = parse(read_plain(path, "network") if content is None else content, path, "net", "network")
    left_hand = root.get("lefthand") == "true"
    try:
        lanes, edges = _read_edges(root, left_hand)
        index = {lane.id: lane.index for lane in lanes}
        connections = _read_connections(root, edges, index)
        _turn_touching(lanes, connections)
        junctions = {
            str(e.attrib["id"]): Junction(
                str(e.attrib["id"]),
                float(e.attrib["x"]),
                float(e.attrib["y"]),
                _points(e.get("shape", "")),
                type=e.get("type", ""),
            )
            for e in root.iterfind("junction")
            if e.get("type") != "internal"
        }
        crossings = _read_crossings(root)
        class_speed = {str(e.attrib["id"]): float(e.attrib["speed"]) for e in root.iterfind("type")}
    except (KeyError, ValueError, IndexError) as error:
        raise InputError(f"{path}: malformed network ({type(error).__name__}: {error})") from None
    if not lanes:
        raise InputError(f"{path}: a network without lanes")
    outgoing: list[list[Connection]] = [[] for _ in lanes]
    for connection in connections:
        outgoing[connection.from_lane].append(connection)
    return RoadNetwork(
        lanes=tuple(lanes),
        lane_index=index,
        edges=edges,
        junctions=junctions,
        connections=tuple(connections),
        outgoing=tuple(tuple(c) for c in outgoing),
        crossings=crossings,
        class_speed=class_speed,
        left_hand=left_hand,
    )
