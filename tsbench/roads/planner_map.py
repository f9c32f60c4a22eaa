"""From SUMO's network to the map that planners are given, and from places on the one to places on the other.

Made once per network, and kept with it. Units: m.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from tsbench.geometry.polyline import Array, Polyline
from tsbench.roads.lane_graph import MapGraph
from tsbench.roads.network import Connection, RoadNetwork
from tsbench.roads.reserved_lanes import contraflow_lanes, open_lanes
from tsbench.roads.road_map import Crossing, MapConnection, MapEdge, MapJunction, MapLane, RoadMap, lanes_beside

_TOUCH_M = 0.01


@dataclass(frozen=True, slots=True)
class Place:
    """Where a lane of SUMO's is on the map: its arc length s is `start + sign * s` of `lane` (-1: on none)."""

    lane: int
    start: float
    sign: float


_NOWHERE = Place(-1, 0.0, 1.0)


@dataclass(frozen=True)
class PlannerMap:
    """A network as planners see it.

    map, graph: theirs. places: by SUMO's lane. edges: for each of SUMO's edges that is on it, where its kerbside lane
    for cars is. chains: SUMO's edges of each of the map's, in order. crossed: SUMO's connection of each path lane of
    the map; none of those where lanes touch. lane_of: (n + 1,) `places` as lanes alone, the last one for lane -1.
    """

    map: RoadMap
    graph: MapGraph
    places: tuple[Place, ...]
    edges: Mapping[str, Place]
    chains: Mapping[str, tuple[str, ...]]
    crossed: Mapping[int, Connection]
    lane_of: npt.NDArray[np.int32]

    def place(self, lane: int, s: float) -> tuple[int, float]:
        """A place on SUMO's lane (index, arc length) on the map; (-1, 0) where that has none."""
        at = self.places[lane] if lane >= 0 else _NOWHERE
        return at.lane, at.start + at.sign * s if at.lane >= 0 else 0.0

    def on_edge(self, edge: str, s: float = 0.0) -> tuple[str, float]:
        """A place on one of SUMO's edges as the map's edge and arc length; KeyError for an edge that is not on it."""
        at = self.edges[edge]
        return self.map.lanes[at.lane].edge, at.start + at.sign * s

    def sumo_edges(self, edges: Iterable[str]) -> tuple[str, ...]:
        """SUMO's edges along edges of the map; unknown ones as they are."""
        return tuple(one for edge in edges for one in self.chains.get(edge, (edge,)))


def build_planner_map(network: RoadNetwork) -> PlannerMap:
    """The map of a network."""
    return _MapBuilder(network).result()


class _MapBuilder:
    """The steps of `build_planner_map`: lanes of edges, chains of edges, then lanes, paths and the rest."""

    def __init__(self, network: RoadNetwork) -> None:
        self.network = network
        self.turned = contraflow_lanes(network)
        opened = open_lanes(network)
        self.parts: dict[str, list[int]] = {}
        for edge in network.edges.values():
            own = [i for i in edge.lanes if i in opened]
            own += [t.lane for t in self.turned.values() if t.host == edge.id and own]
            if own:
                self.parts[edge.id] = own
        self.edge_of = {lane: edge for edge, lanes in self.parts.items() for lane in lanes}
        self.links: dict[tuple[int, int], Connection | None] = {
            (c.from_lane, c.to_lane): c
            for c in network.connections
            if c.from_lane in self.edge_of
            and c.to_lane in self.edge_of
            # SUMO's own direction of a lane that seems turned round leads nowhere.
            and c.from_lane not in self.turned
            and c.to_lane not in self.turned
        }
        self.links |= {(t.entry, t.lane): None for t in self.turned.values() if t.entry in self.edge_of}
        self.chains = self._chains()
        self.name_of = {edge: name for name, chain in self.chains.items() for edge in chain}
        self.lanes: list[MapLane] = []
        self.edges: dict[str, MapEdge] = {}
        self.places = [_NOWHERE] * len(network.lanes)
        self.crossed: dict[int, Connection] = {}

    def result(self) -> PlannerMap:
        for name in sorted(self.chains):
            self._edge(name, self.chains[name])
        connections = self._paths()
        outgoing: list[list[MapConnection]] = [[] for _ in self.lanes]
        for connection in connections:
            outgoing[connection.from_lane].append(connection)
        roads = RoadMap(
            lanes=tuple(self.lanes),
            lane_index=MappingProxyType({lane.id: lane.index for lane in self.lanes}),
            edges=MappingProxyType(self.edges),
            junctions=MappingProxyType(self._junctions()),
            connections=tuple(connections),
            outgoing=tuple(tuple(c) for c in outgoing),
            crossings=MappingProxyType(dict(self._crossings())),
            left_hand=self.network.left_hand,
        )
        lane_of = np.array([place.lane for place in (*self.places, _NOWHERE)], dtype=np.int32)
        lane_of.setflags(write=False)
        of_edge = MappingProxyType({edge: self.places[lanes[0]] for edge, lanes in self.parts.items()})
        chains, crossed = MappingProxyType(self.chains), MappingProxyType(self.crossed)
        return PlannerMap(roads, MapGraph(roads), tuple(self.places), of_edge, chains, crossed, lane_of)

    def _chains(self) -> dict[str, tuple[str, ...]]:
        """Edges that follow each other with nothing between them but a cut, by the name that they get together."""
        after, before = self._next_edges()
        onward = {a: b for a, (b, *more) in after.items() if not more and before[b] == [a] and self._continues(a, b)}
        heads = [edge for edge in sorted(self.parts) if edge not in onward.values()]
        found: dict[str, tuple[str, ...]] = {}
        done: set[str] = set()
        # A ring of cuts has no head: it begins anywhere.
        for head in [*heads, *sorted(self.parts)]:
            chain = []
            edge: str | None = head
            while edge is not None and edge not in done:
                chain.append(edge)
                done.add(edge)
                edge = onward.get(edge)
            if chain:
                found[self._name(chain)] = tuple(chain)
        return found

    def _next_edges(self) -> tuple[dict[str, list[str]], dict[str, list[str]]]:
        """By edge: those that it leads to, and those that lead to it."""
        after: dict[str, list[str]] = {}
        before: dict[str, list[str]] = {}
        for a, b in sorted({(self.edge_of[a], self.edge_of[b]) for a, b in self.links}):
            after.setdefault(a, []).append(b)
            before.setdefault(b, []).append(a)
        return after, before

    def _continues(self, a: str, b: str) -> bool:
        """Is an edge the same road as the one that it leads to, lane by lane?"""
        own, other = self.parts[a], self.parts[b]
        straight = set(zip(own, other, strict=False))
        crossing = {(i, j) for i, j in self.links if self.edge_of[i] == a and self.edge_of[j] == b}
        lanes = self.network.lanes
        if a == b or len(own) != len(other) or crossing != straight or self._speed(a) != self._speed(b):
            return False
        return all(lanes[i].width == lanes[j].width for i, j in straight)

    def _name(self, chain: Sequence[str]) -> str:
        """The road's own name where a scene has cut it ("road.0", "road.1"), else that of its first edge."""
        stems = {edge.rpartition(".")[0] for edge in chain}
        stem = stems.pop()
        return chain[0] if len(chain) == 1 or stems or not stem or stem in self.parts else stem

    def _speed(self, edge: str) -> float:
        return self.network.expected_speed(edge)

    def _edge(self, name: str, chain: tuple[str, ...]) -> None:
        rows = list(zip(*(self.parts[edge] for edge in chain), strict=True))
        base = len(self.lanes)
        for order, row in enumerate(rows):
            index = base + order
            lane, line = f"{name}_{order}", self._line(index, row)
            width, speed = self.network.lanes[row[0]].width, self._speed(chain[0])
            beside = lanes_beside(index, order, len(rows), self.network.left_hand)
            self.lanes.append(MapLane(index, lane, name, order, line, width, speed, False, **beside))
        first, last = (self.network.edges[edge] for edge in (chain[0], chain[-1]))
        lanes, length = tuple(range(base, base + len(rows))), self.lanes[base].line.length
        self.edges[name] = MapEdge(name, first.source, last.target, lanes, False, length)

    def _line(self, index: int, row: Sequence[int]) -> Polyline:
        """One lane's line through all edges of a chain; notes where the lanes are on it."""
        parts: list[Array] = []
        for k, lane in enumerate(row):
            link = self.links[row[k - 1], lane] if k else None
            for via in link.via if link else ():
                self._note(via, index, parts)
            self._note(lane, index, parts)
        return joined(parts)

    def _note(self, lane: int, index: int, parts: list[Array]) -> None:
        line = self.network.lanes[lane].line
        turned = lane in self.turned
        points = line.points[::-1] if turned else line.points
        whole = np.vstack([*parts, points[:1]]) if parts else points[:1]
        start = float(np.hypot(*np.diff(whole, axis=0).T).sum())
        self.places[lane] = Place(index, start + line.length, -1.0) if turned else Place(index, start, 1.0)
        parts.append(points)

    def _paths(self) -> list[MapConnection]:
        """The connections between edges of the map, with a path lane each."""
        within = {(a, b) for chain in self.chains.values() for a, b in self._cuts(chain)}
        ends = sorted((self.places[a].lane, self.places[b].lane, a, b) for a, b in self.links if (a, b) not in within)
        found = []
        for a, b, lane, target in ends:
            link = self.links[lane, target]
            path = self._path(a, b, link)
            if path is not None and link is not None:
                self.crossed[path] = link
            found.append(MapConnection(a, b, () if path is None else (path,)))
        return found

    def _cuts(self, chain: Sequence[str]) -> Iterator[tuple[int, int]]:
        for a, b in pairwise(chain):
            yield from zip(self.parts[a], self.parts[b], strict=True)

    def _path(self, a: int, b: int, link: Connection | None) -> int | None:
        """The path lane from one lane of the map to another; None where they touch."""
        source, target, index = self.lanes[a], self.lanes[b], len(self.lanes)
        parts: list[Array] = []
        for via in link.via if link else ():
            self._note(via, index, parts)
        if not parts:
            gap = np.vstack((source.line.points[-1], target.line.points[0]))
            if np.hypot(*(gap[1] - gap[0])) <= _TOUCH_M:
                return None
            parts = [gap]
        width = min((self.network.lanes[v].width for v in link.via), default=source.width) if link else source.width
        name, speed = f"{source.id}>{target.id}", min(source.speed, target.speed)
        self.lanes.append(MapLane(index, name, "", 0, joined(parts), width, speed, True))
        return index

    def _junctions(self) -> dict[str, MapJunction]:
        ends = {node for edge in self.edges.values() for node in (edge.source, edge.target)}
        found = {}
        for name in sorted(ends & set(self.network.junctions)):
            one = self.network.junctions[name]
            area = one.polygon.copy()
            area.setflags(write=False)
            found[name] = MapJunction(name, one.x, one.y, area)
        return found

    def _crossings(self) -> Iterator[tuple[str, Crossing]]:
        """Those of one road are numbered from the second on."""
        count = Counter[str]()
        for one in sorted(self.network.crossings.values(), key=lambda c: c.line.points.tolist()):
            roads = tuple(dict.fromkeys(self.name_of[edge] for edge in one.edges if edge in self.name_of))
            name = f"crossing_{'_'.join(roads)}"
            count[name] += 1
            name += f"_{count[name]}" if count[name] > 1 else ""
            yield name, replace(one, id=name, edges=roads)


# netconvert rounds to centimetres: a point put in on a straight line is at most so far beside it.
_BESIDE_M = 0.015


def joined(parts: Sequence[Array]) -> Polyline:
    """The line through (k, 2) points of parts that follow each other.

    SUMO cuts the path of a turn where a car would wait, which depends on the right of way. So the points
    at cuts go first where they lie on the line without them; then whatever others do, the least first, that one drive
    gives one line however it was cut.
    """
    points = [part[0] for part in parts[:1]]
    cuts: set[int] = set()
    for number, part in enumerate(parts):
        if number and np.hypot(*(part[0] - points[-1])) > _BESIDE_M:
            points.append(part[0])
        elif number:
            cuts.add(len(points) - 1)
        points.extend(part[1:])
    line = np.array(points)
    kept = [k for k in range(len(line)) if k not in cuts or _beside(line, _whole(k, cuts, len(line))) > _BESIDE_M]
    while len(kept) > 2:
        away = [_beside(line, kept[k - 1 : k + 2]) for k in range(1, len(kept) - 1)]
        least = int(np.argmin(away))
        if away[least] > _BESIDE_M:
            break
        del kept[least + 1]
    return Polyline(line[kept])


def _whole(k: int, cuts: set[int], count: int) -> list[int]:
    """A point with the nearest ones before and behind it that no cut put in."""
    before = next(i for i in range(k - 1, -1, -1) if i not in cuts or i == 0)
    behind = next(i for i in range(k + 1, count) if i not in cuts or i == count - 1)
    return [before, k, behind]


def _beside(line: Array, three: list[int]) -> float:
    """How far the middle one of three points is from the straight line between the others."""
    (ax, ay), (x, y), (bx, by) = line[three].tolist()
    dx, dy = bx - ax, by - ay
    length = float(np.hypot(dx, dy))
    return abs(dx * (y - ay) - dy * (x - ax)) / length if length > 0.0 else float(np.hypot(x - ax, y - ay))
