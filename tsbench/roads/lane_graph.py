"""The lane graph: routes over edges, and reference paths over lanes. Units: m, m/s, rad."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple, cast

import numpy as np

from tsbench.core.frozen import Frozen
from tsbench.geometry.elementary import turn_class, wrap
from tsbench.geometry.polyline import Array, Polyline
from tsbench.roads.network import Connection, RoadNetwork
from tsbench.roads.reserved_lanes import ContraflowLane, contraflow_lanes, open_lanes
from tsbench.roads.road_map import MapConnection, RoadMap


@dataclass(frozen=True, slots=True)
class Destination:
    """The point to reach: edge id and arc length along it (m); any lane of the edge counts."""

    edge: str
    s: float


class Reached(NamedTuple):
    """A node that can be reached. cost: of the shortest way to it. before: the node before it, -1 for the first."""

    cost: float
    before: int


def shortest_ways(
    start: int, onward: Callable[[int, float], Iterable[tuple[int, float]]], target: int | None = None
) -> dict[int, Reached]:
    """Every node that can be reached from `start`, nearest first, by Dijkstra's algorithm.

    onward: of a node and what it costs to get there, each node after it with what it costs to get to that, not less.
    target: nothing beyond it is looked for. Of nodes at the same cost, the one with the lower number comes first; of
    ways to a node at the same cost, the one that comes from the node reached earlier is kept.
    """
    best, queue = {start: Reached(0.0, -1)}, [(0.0, start)]
    found: dict[int, Reached] = {}
    while queue and target not in found:
        cost, node = heapq.heappop(queue)
        if node in found:
            continue
        found[node] = best[node]
        for following, total in onward(node, cost):
            if following not in best or total < best[following].cost:
                best[following] = Reached(total, node)
                heapq.heappush(queue, (total, following))
    return found


def way_to(target: int, found: Mapping[int, Reached]) -> list[int]:
    """Nodes of the shortest way to `target`, both ends included; none where it cannot be reached."""
    way: list[int] = []
    while target in found:
        way.append(target)
        target = found[target].before
    return way[::-1]


Turn = tuple[str, str]
_BLEND_STEP_M = 2.0


def heading_change(network: RoadMap, source: str, target: str) -> float:
    """Change of heading (rad, left positive) from the end of one edge to the start of the next."""
    a = network.lanes[network.edges[source].lanes[0]].line
    b = network.lanes[network.edges[target].lanes[0]].line
    return wrap(b.heading_at(min(1.0, b.length)) - a.heading_at(max(a.length - 1.0, 0.0)))


@dataclass(frozen=True, slots=True)
class PathPiece:
    """A stretch [s0, s1] of a path on one lane (index); during a lane change, the lane that it leads to."""

    s0: float
    s1: float
    lane: int


@dataclass(frozen=True)
class RoutePath:
    """A drivable reference line over lanes to the destination and on to the end of its edge.

    edges: ordinary edges in order. limit_s, limit: (k,) speed limit (m/s) from each arc length on.
    destination_s: where the destination is on the line.
    """

    edges: tuple[str, ...]
    line: Polyline
    pieces: tuple[PathPiece, ...]
    limit_s: Array
    limit: Array
    destination_s: float

    def limit_at(self, s: float) -> float:
        i = int(np.searchsorted(self.limit_s, s, side="right")) - 1
        return float(self.limit[max(i, 0)])

    def lane_at(self, s: float) -> int:
        for piece in self.pieces:
            if s <= piece.s1:
                return piece.lane
        return self.pieces[-1].lane


class MapGraph(Frozen):
    """Routes and paths over a map, on which every lane is for cars. closed: lanes (indices) not to use all the same."""

    network: RoadMap
    _open: frozenset[int]
    _turned: Mapping[int, ContraflowLane]
    _next: Mapping[str, Mapping[str, tuple[MapConnection, ...]]]

    __slots__ = ("_next", "_open", "_turned", "network")

    def __init__(self, network: RoadMap, closed: AbstractSet[int] = frozenset()) -> None:
        lanes = frozenset(lane.index for lane in network.lanes if not lane.internal)
        self._fill(network, lanes - closed, {})

    def _fill(self, network: RoadMap, opened: frozenset[int], turned: Mapping[int, ContraflowLane]) -> None:
        onward: dict[str, dict[str, list[MapConnection]]] = {}
        for connection in network.connections:
            if connection.from_lane not in opened or connection.to_lane not in opened:
                continue
            a, b = network.lanes[connection.from_lane], network.lanes[connection.to_lane]
            onward.setdefault(a.edge, {}).setdefault(b.edge, []).append(connection)
        filled = {
            "network": network,
            "_open": opened,
            "_turned": MappingProxyType(dict(turned)),
            "_next": MappingProxyType(
                {a: MappingProxyType({b: tuple(c) for b, c in to.items()}) for a, to in onward.items()}
            ),
        }
        for name, value in filled.items():
            object.__setattr__(self, name, value)

    def edge_of(self, lane: int) -> str:
        """The edge that a lane (index) is a lane of; a contraflow lane of the one that it seems to belong to."""
        turned = self._turned.get(lane)
        return self.network.lanes[lane].edge if turned is None else turned.host

    def line_of(self, lane: int) -> Polyline:
        """A lane's centre line in the direction of `edge_of` it."""
        turned = self._turned.get(lane)
        return self.network.lanes[lane].line if turned is None else turned.line

    def order_of(self, lane: int) -> int:
        """A lane's place on `edge_of` it, 0 = at the kerb."""
        turned = self._turned.get(lane)
        return self.network.lanes[lane].order if turned is None else turned.order

    def successors(self, edge: str) -> tuple[str, ...]:
        return tuple(self._next.get(edge, ()))

    def connections(self, source: str, target: str) -> tuple[MapConnection, ...]:
        """Connections from one edge to the next, in file order; empty where there are none."""
        return self._next[source].get(target, ()) if source in self._next else ()

    def turn(self, source: str, target: str) -> str:
        """Manoeuvre class from one edge to the next, by their headings at the junction."""
        return turn_class(math.degrees(heading_change(self.network, source, target)))

    def crossing_length(self, source: str, target: str) -> float:
        """Shortest way through the junction between two edges."""
        lanes = self.network.lanes
        return min(sum(lanes[v].line.length for v in c.via) for c in self._next[source][target])

    def route(
        self,
        source: str,
        target: str,
        avoid_turns: AbstractSet[Turn] = frozenset(),
        avoid_edges: AbstractSet[str] = frozenset(),
    ) -> tuple[str, ...] | None:
        """Shortest edge sequence from `source` to `target` (both included), or None.

        avoid_turns: (from edge, to edge) pairs not to drive; avoid_edges: edges not to enter. Ties are broken by
        the order of edges in the network file.
        """
        edges = list(self.network.edges)
        number = {edge: k for k, edge in enumerate(edges)}

        def onward(k: int, cost: float) -> Iterator[tuple[int, float]]:
            edge = edges[k]
            for following in self._next.get(edge, ()):
                if following not in avoid_edges and (edge, following) not in avoid_turns:
                    length = self.network.edges[following].length
                    yield number[following], cost + self.crossing_length(edge, following) + length

        goal = number.get(target, -1)
        way = way_to(goal, shortest_ways(number[source], onward, goal))
        return tuple(edges[k] for k in way) or None

    def path(
        self, edges: tuple[str, ...], lane: int, s: float, destination: Destination, room: float = math.inf
    ) -> RoutePath | None:
        """Reference path along `edges` from arc length `s` of `lane`, with the fewest lane changes.

        room: metres that there are for a change on the first edge, at most those to its end.
        `lane` lies on the first edge, or is an internal lane that leads into it. None where the lanes do not connect.
        """
        changes = self._changes_to_go(edges)
        builder = _PathBuilder(self)
        if lane in self._turned:
            s = self._turned[lane].line.length - s
        if self.network.lanes[lane].internal:
            after = builder.through(lane, s)
            if after < 0 or self.network.lanes[after].edge != edges[0]:
                return None
            lane, s = after, 0.0
        for k, edge in enumerate(edges):
            last = k == len(edges) - 1
            options = changes[k]
            keep = [
                (abs(self.order_of(i) - self.order_of(lane)) + left, i != lane, i)
                for i, left in options.items()
                if left < math.inf
            ]
            if not keep:
                return None
            chosen = min(keep)[2]
            builder.along(lane, chosen, s, math.inf if k else room)
            if last:
                break
            steps = [c for c in self._steps(edge, edges[k + 1]) if c[0] == chosen]
            _, lane, inner = min(steps, key=lambda c: (changes[k + 1][c[1]], c[1]))
            for via in inner:
                builder.add(via, 0.0)
            s = 0.0
        return builder.finish(edges, destination)

    def _steps(self, source: str, target: str) -> list[tuple[int, int, tuple[int, ...]]]:
        """Ways from one edge to the next: lane from, lane to, lanes between."""
        lanes = self.network.edges[source].lanes
        steps = [(c.from_lane, c.to_lane, c.via) for c in self.connections(source, target)]
        turned = (t for t in self._turned.values() if t.host == target and t.entry in lanes)
        return steps + [(t.entry, t.lane, ()) for t in turned]

    def _changes_to_go(self, edges: tuple[str, ...]) -> list[dict[int, float]]:
        """For each edge, the lane changes needed after leaving it from each lane; inf where there is no way on."""
        table: list[dict[int, float]] = [{} for _ in edges]
        for k in range(len(edges) - 1, -1, -1):
            turned = [t.lane for t in self._turned.values() if t.host == edges[k]]
            row = dict.fromkeys([*self.network.edges[edges[k]].lanes, *turned], math.inf)
            if k == len(edges) - 1:
                row.update((i, 0.0) for i in row if i in self._open or i in self._turned)
            else:
                reach = table[k + 1]
                for start, end, _ in self._steps(edges[k], edges[k + 1]):
                    cost = min(abs(self.order_of(i) - self.order_of(end)) + reach[i] for i in reach)
                    row[start] = min(row[start], cost)
            table[k] = row
        return table


class LaneGraph(MapGraph):
    """The same over a network of SUMO's, blind to lanes that plates reserve (roads.reserved_lanes)."""

    network: RoadNetwork

    __slots__ = ()

    def __init__(self, network: RoadNetwork, closed: AbstractSet[int] = frozenset()) -> None:
        turned = {i: t for i, t in contraflow_lanes(network).items() if i not in closed}
        self._fill(network, open_lanes(network) - closed, turned)

    def connections(self, source: str, target: str) -> tuple[Connection, ...]:
        """Connections from one edge to the next, in file order; empty where there are none."""
        return cast(tuple[Connection, ...], super().connections(source, target))


class _PathBuilder:
    """Collects stretches of lanes into one line."""

    def __init__(self, graph: MapGraph) -> None:
        self.graph, self.network = graph, graph.network
        self.chunks: list[Array] = []
        self.lanes: list[int] = []
        self.first_s = 0.0

    def add(self, lane: int, s: float) -> None:
        """The rest of a lane from arc length s."""
        line = self.graph.line_of(lane)
        if line.length - s > 1e-3:
            self._push(line.slice(s, line.length).points if s > 0.0 else line.points, lane)

    def through(self, lane: int, s: float) -> int:
        """The rest of an internal lane and those behind it; returns the ordinary lane they lead to, or -1."""
        for connection in self.network.connections:
            if lane in connection.via:
                k = connection.via.index(lane)
                self.add(lane, s)
                for via in connection.via[k + 1 :]:
                    self.add(via, 0.0)
                return connection.to_lane
        return -1

    def along(self, lane: int, target: int, s: float, room: float) -> None:
        """Along an edge from arc length s of `lane`, changing to `target` (same edge), if another, in some room."""
        if lane == target:
            self.add(lane, s)
            return
        a, b = self.graph.line_of(lane), self.graph.line_of(target)
        span = min(a.length - s, room)
        steps = abs(self.graph.order_of(lane) - self.graph.order_of(target))
        length = min(40.0 * steps, max(span - 10.0, span * 0.8))
        if length < _BLEND_STEP_M:
            self.add(target, min(s, b.length))
            return
        at = np.linspace(0.0, length, max(int(length / _BLEND_STEP_M), 2))
        weight = 0.5 - 0.5 * np.cos(np.pi * at / length)
        pa = np.array([a.point_at(s + t) for t in at])
        pb = np.array([b.point_at((s + t) * b.length / a.length) for t in at])
        self._push(pa + weight[:, None] * (pb - pa), target)
        self.add(target, (s + length) * b.length / a.length + 0.1)

    def _push(self, points: Array, lane: int) -> None:
        self.chunks.append(points)
        self.lanes.append(lane)

    def finish(self, edges: tuple[str, ...], destination: Destination) -> RoutePath | None:
        """The path, or None where nothing is left of it."""
        if not self.chunks:
            return None
        line = Polyline(np.vstack(self.chunks))
        sizes = [float(np.hypot(*np.diff(c, axis=0).T).sum()) for c in self.chunks]
        gaps = [0.0] + [float(np.hypot(*(b[0] - a[-1]))) for a, b in zip(self.chunks, self.chunks[1:], strict=False)]
        pieces, s = [], 0.0
        for size, gap, lane in zip(sizes, gaps, self.lanes, strict=True):
            pieces.append(PathPiece(s, s + gap + size, lane))
            s += gap + size
        final = self.network.lanes[self.network.edges[edges[-1]].lanes[0]].line
        end = final.length - destination.s
        return RoutePath(
            edges=edges,
            line=line,
            pieces=tuple(pieces),
            limit_s=_fixed([p.s0 for p in pieces]),
            limit=_fixed([self.network.lanes[p.lane].speed for p in pieces]),
            destination_s=line.length - end,
        )


def _fixed(values: list[float]) -> Array:
    array = np.array(values)
    array.setflags(write=False)
    return array
