"""The roads of a network as a traffic office sees them: arms, junctions, approaches, mouths, rings. Units: m, rad.

An edge is no road: where two roads meet without a third, or a scene has cut an edge, the road goes on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from operator import attrgetter

from tsbench.geometry.elementary import LEFT, RIGHT, STRAIGHT, U_TURN, turn_class, wrap
from tsbench.geometry.polyline import Polyline
from tsbench.roads.lane_graph import LaneGraph, Turn, heading_change
from tsbench.roads.network import Edge
from tsbench.signs.model import Distances

_MOST_EDGES = 40


@dataclass(frozen=True, slots=True)
class WayOn:
    """The way on from a place to the next junction. edges: in order, the place's own first. distance: to the line.

    junction: id, "" where the map ends before one.
    """

    edges: tuple[str, ...]
    distance: float
    junction: str


class PlateRoads:
    """Arms and ways of one network, each computed once."""

    def __init__(self, *, graph: LaneGraph, distances: Distances) -> None:
        self.network, self.graph = graph.network, graph
        self._ring = distances.ring_m
        self._swerves: dict[str, float] = {}
        self._same_arm = math.radians(distances.same_arm_deg)

    def length(self, edge: str) -> float:
        """Length of an edge as it is drawn."""
        return self.network.edge_lanes(edge)[0].line.length

    @cached_property
    def _car_edges(self) -> tuple[Edge, ...]:
        lanes = self.network.lanes
        return tuple(
            e
            for e in self.network.edges.values()
            if not e.internal and any(lanes[i].permits("passenger") for i in e.lanes)
        )

    @cached_property
    def _at(self) -> dict[str, tuple[list[str], list[str]]]:
        """By node: edges in, edges out."""
        found: dict[str, tuple[list[str], list[str]]] = {}
        for edge in self._car_edges:
            found.setdefault(edge.source, ([], []))[1].append(edge.id)
            found.setdefault(edge.target, ([], []))[0].append(edge.id)
        return found

    @cached_property
    def _pairs(self) -> dict[str, dict[str, str]]:
        """By node: edges in with the edge out of the same arm, where there is one."""
        found: dict[str, dict[str, str]] = {}
        for node, (into, out) in self._at.items():
            free, pairs = list(out), found.setdefault(node, {})
            for a in into:
                near = [b for b in free if self._is_same_arm(a, b, node)]
                if near:
                    pairs[a] = min(near, key=lambda b: (self._turned(a, b), b))
                    free.remove(pairs[a])
        return found

    def _is_same_arm(self, into: str, out: str, node: str) -> bool:
        edges = self.network.edges
        pair = edges[into].source == edges[out].target != node
        return pair or self._turned(into, out) <= self._same_arm

    def _turned(self, into: str, out: str) -> float:
        """How far the way back is from a full turn."""
        return math.pi - abs(heading_change(self.network, into, out))

    def arms(self, node: str) -> int:
        """Number of roads at a node, a pair of opposite edges counted once."""
        into, out = self._at.get(node, ([], []))
        return len(into) + len(out) - len(self._pairs.get(node, {}))

    def is_junction(self, node: str) -> bool:
        """Do at least three roads meet there?"""
        return self.arms(node) >= 3

    def one_way(self, edge: str) -> bool:
        """Has the road no lane for cars in the other direction?"""
        start = self._pairs.get(self.network.edges[edge].source, {})
        return edge not in start.values() and self._way_back(edge) is None

    def other_direction(self, road: Iterable[str]) -> set[str]:
        """Edges for cars beside those of a road, the other way."""
        ends = {(self.network.edges[e].target, self.network.edges[e].source) for e in road}
        beside = {e.id for e in self._car_edges if (e.source, e.target) in ends}
        return beside.union(filter(None, map(self._way_back, road)))

    def _way_back(self, edge: str) -> str | None:
        """The edge of the same arm by which traffic leaves the node at an edge's end."""
        return self._pairs.get(self.network.edges[edge].target, {}).get(edge)

    def ways_on(self, edge: str) -> tuple[str, ...]:
        """Edges behind the end of an edge, without the way back."""
        back = self._way_back(edge)
        return tuple(e for e in self.graph.successors(edge) if e != back and self.graph.turn(edge, e) != U_TURN)

    def ways_to(self, edge: str) -> tuple[str, ...]:
        """Edges that lead into an edge, without the way back."""
        into = self._at.get(self.network.edges[edge].source, ([], []))[0]
        return tuple(e for e in into if edge in self.ways_on(e))

    def approach(self, *, edge: str, s: float) -> WayOn:
        """From `s` along an edge to the next junction."""
        return self._to_junction(edge, self.length(edge) - s, self.ways_on, attrgetter("target"))

    def back(self, *, edge: str, s: float) -> WayOn:
        """From `s` along an edge against its direction to the junction before it."""
        return self._to_junction(edge, s, self.ways_to, attrgetter("source"))

    def _to_junction(
        self, edge: str, distance: float, onward: Callable[[str], tuple[str, ...]], end: Callable[[Edge], str]
    ) -> WayOn:
        """Over edges that go on as one road. distance: to the first edge's end. end: the node that a way leads to."""
        edges = [edge]
        while len(edges) < _MOST_EDGES:
            node = end(self.network.edges[edges[-1]])
            if self.is_junction(node):
                return WayOn(tuple(edges), distance, node)
            ways = onward(edges[-1])
            if len(ways) != 1 or ways[0] in edges:
                break
            edges.append(ways[0])
            distance += self.length(ways[0])
        return WayOn(tuple(edges), distance, "")

    def swerve(self, node: str) -> float:
        """How far the ways straight on over a junction lead aside and back again, degrees: 0 between opposite arms.

        Of the way that does most, the lesser of the two turns.
        """
        if node not in self._swerves:
            into, lanes = self._at[node][0], self.network.lanes
            turns = [
                _aside_and_back(lanes[c.from_lane].line, lanes[c.to_lane].line)
                for c in self.network.connections
                if lanes[c.from_lane].edge in into
                and self.graph.turn(lanes[c.from_lane].edge, lanes[c.to_lane].edge) == STRAIGHT
            ]
            self._swerves[node] = math.degrees(max(turns, default=0.0))
        return self._swerves[node]

    def gives_way_to(self, approach: str) -> tuple[frozenset[str], ...]:
        """For each connection from an approach, the edges of other arms whose traffic has right of way over it."""
        lanes, ways = self.network.lanes, self.ways_on(approach)
        node = self.network.edges[approach].target
        there = [c for c in self.network.connections if self.network.edges[lanes[c.from_lane].edge].target == node]
        return tuple(
            frozenset(lanes[o.from_lane].edge for o in there if not c.yields_to.isdisjoint(o.via)) - {approach}
            for c in there
            if lanes[c.from_lane].edge == approach and lanes[c.to_lane].edge in ways
        )

    def main_ways(self, approach: str) -> set[str]:
        """Edges by which traffic from an approach stays on the main road: others wait, straight on or both ways."""
        back = self.other_direction([approach])
        return {
            e
            for e in self._first_ways(approach)
            if self.graph.turn(approach, e) == STRAIGHT
            or any(back & self._first_ways(b) for b in self.other_direction([e]))
        }

    def _first_ways(self, approach: str) -> set[str]:
        """Edges onto which traffic from an approach has right of way over all others."""
        lanes = self.network.lanes
        links = (c for i in self.network.edges[approach].lanes for c in self.network.outgoing[i])
        return {lanes[c.to_lane].edge for c in links if not c.yields_to}

    def across(self, approach: str) -> dict[str, tuple[frozenset[str], frozenset[str]]]:
        """The road across an approach's end, by side (LEFT, RIGHT): edges that lead there and that come from there."""
        node = self.network.edges[approach].target
        into, out = self._at[node]
        pairs = self._pairs[node]
        leads = {e: self.graph.turn(approach, e) for e in out if e != pairs.get(approach)}
        # The way back over an arm leaves by the side from which an edge comes.
        comes = {e: leads[pairs[e]] if e in pairs else self._turn_back(approach, e) for e in into if e != approach}
        return {side: (_of(leads, side), _of(comes, side)) for side in (LEFT, RIGHT)}

    def _turn_back(self, approach: str, edge: str) -> str:
        """Class of the turn from an approach onto another edge that comes in, against its direction."""
        a, b = (self.network.edge_lanes(e)[0].line for e in (approach, edge))
        first, last = (line.heading_at(max(line.length - 1.0, 0.0)) for line in (a, b))
        return turn_class(math.degrees(math.pi + last - first))

    def leads_to_ring(self, approach: str) -> bool:
        """Is the junction at the end of an approach an entry of a ring?"""
        return any(True for _ in self._rings(approach))

    def _rings(self, approach: str) -> Iterator[tuple[str, ...]]:
        """Ways round from the end of an approach back to it, over one-way edges, turning once to one side."""
        node = self.network.edges[approach].target
        open_ways: list[tuple[str, ...]] = [(e,) for e in self.ways_on(approach) if self.one_way(e)]
        while open_ways:
            way = open_ways.pop()
            if sum(map(self.length, way)) > self._ring or len(way) > _MOST_EDGES:
                continue
            if self.network.edges[way[-1]].target == node:
                turned = sum(self._bend(e) for e in way)
                turned += sum(heading_change(self.network, a, b) for a, b in zip(way, (*way[1:], way[0]), strict=True))
                if abs(abs(turned) - 2.0 * math.pi) < 0.5 and (turned < 0.0) == self.network.left_hand:
                    yield way
                continue
            open_ways += [(*way, e) for e in self.ways_on(way[-1]) if self.one_way(e) and e not in way]

    def _bend(self, edge: str) -> float:
        line = self.network.edge_lanes(edge)[0].line
        headings = [line.heading_at(s) for s in _places(line.length)]
        return sum(wrap(b - a) for a, b in pairwise(headings))


def _aside_and_back(line: Polyline, onward: Polyline) -> float:
    """From one lane's end to another's start: the lesser turn, rad, where the two go to different sides, else 0."""
    (x0, y0), (x1, y1) = line.point_at(line.length), onward.point_at(0.0)
    direct = math.atan2(y1 - y0, x1 - x0)
    aside = wrap(direct - line.heading_at(max(line.length - 1.0, 0.0)))
    back = wrap(onward.heading_at(min(1.0, onward.length)) - direct)
    return min(abs(aside), abs(back)) if aside * back < 0.0 else 0.0


def _of(turns: Mapping[str, str], side: str) -> frozenset[str]:
    return frozenset(e for e, turn in turns.items() if turn == side)


@lru_cache(maxsize=4)
def plate_roads(graph: LaneGraph, distances: Distances) -> PlateRoads:
    """The roads of a network by a catalogue's distances."""
    return PlateRoads(graph=graph, distances=distances)


def _places(length: float) -> list[float]:
    """Places along a line of some length, at most 2 m apart, a metre off its ends."""
    first, last = min(1.0, length), max(length - 1.0, 0.0)
    steps = max(int((last - first) / 2.0), 1)
    return [first + (last - first) * k / steps for k in range(steps + 1)]


@dataclass(frozen=True)
class Sent:
    """Where other traffic is not sent, and which roads it does not use."""

    avoid_turns: frozenset[Turn]
    closed_edges: frozenset[str]


def shut_roads(roads: PlateRoads, shut: Sequence[tuple[str, ...]], *, ego: AbstractSet[str], sent: Sent) -> Sent | None:
    """Other traffic that leaves some more roads alone; None where one of the ego's would have no way on.

    shut: each road as its edges in driving order. ego: edges of its ways. A road from which only ways onto the ego's
    are left is not used either: all its traffic would stand where the ego turns.
    """
    avoid, closed, rest = set(sent.avoid_turns), set(sent.closed_edges), list(shut)
    while rest:
        road = rest.pop()
        closed |= {*road}
        for before in roads.ways_to(road[0]):
            avoid.add((before, road[0]))
            left = {e for e in roads.graph.successors(before) if (before, e) not in avoid}
            if before in ego and not left:
                return None
            if before not in ego | closed and left <= ego:
                rest.append(roads.back(edge=before, s=0.0).edges[::-1])
    return Sent(frozenset(avoid), frozenset(closed))
