"""Where the ego's front is along a road: the line at the end of an approach, and zones over several edges.

The place comes from the snapshot's geometric fields (lane strip, arc length) alone. Units: m, rad.
"""

from __future__ import annotations

import math

from tsbench.geometry.polyline import Polyline, join
from tsbench.roads.network import Lane, RoadNetwork
from tsbench.sim.world import EGO_LENGTH_M, EgoState

_HALF_M = EGO_LENGTH_M / 2


def cut_road(network: RoadNetwork, edge_id: str) -> tuple[str, ...]:
    """The edges in order that a scene has cut a road into ("road.0", "road.1"); an edge that is whole alone."""
    stem, dot, number = edge_id.rpartition(".")
    if not dot or not number.isdigit():
        return (edge_id,)
    # Numbered pieces only: a contraflow ("road.contra") runs against them.
    by_source = {
        e.source: e
        for e in network.edges.values()
        if not e.internal and e.id.startswith(stem + dot) and e.id[len(stem) + 1 :].isdigit()
    }
    inner = {e.target for e in by_source.values()}
    heads = [e for source, e in by_source.items() if source not in inner]
    if len(heads) != 1:
        return (edge_id,)
    chain = [heads[0]]
    # As often as there are edges at most: a road may end in a loop.
    while chain[-1].target in by_source and len(chain) < len(by_source):
        chain.append(by_source[chain[-1].target])
    return tuple(e.id for e in chain) if edge_id in {e.id for e in chain} else (edge_id,)


def reverse_edges(network: RoadNetwork, edge_id: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Edges of the same road in the opposite direction, and the edges of this one that they run along.

    Those between the same two junctions; where a plate has cut this direction alone, those along the whole road.
    """
    for own in ((edge_id,), cut_road(network, edge_id)):
        first, last = network.edges[own[0]], network.edges[own[-1]]
        found = [
            e.id
            for e in network.edges.values()
            if not e.internal and e.source == last.target and e.target == first.source and e.source
        ]
        if found:
            return tuple(found), own
    return (), (edge_id,)


def is_out(ego: EgoState, lane: Lane, at_start: bool) -> bool:
    """Has the whole ego left the junction at an ordinary lane's start (or end)? Its lane may be shorter than it."""
    way = ego.s if at_start else lane.line.length - ego.s
    return way > min(EGO_LENGTH_M, lane.line.length) / 2


class Station:
    """How arc length on one lane becomes metres along the road: start + rate * s.

    along: +1 for lanes of the road's own direction, -1 for those of the opposite one.
    """

    __slots__ = ("along", "line", "rate", "start")

    def __init__(self, lane: Lane, start: float, rate: float, along: float) -> None:
        self.line, self.start, self.rate, self.along = lane.line, start, rate, along


class Road:
    """A stretch of road over edges in order: 0 where the first one starts, `length` where the last one ends.

    An ego that drives along it on the wrong side counts as on it; one that drives against it does not. beside_widths:
    off every lane strip, an ego within this many carriageway widths still drives along the road.
    """

    def __init__(self, network: RoadNetwork, edges: tuple[str, ...], order: int = 0, *, beside_widths: float) -> None:
        self._network = network
        self._stations: dict[int, Station] = {}
        self.starts: dict[str, float] = {}
        self._beside = beside_widths * max(sum(lane.width for lane in network.edge_lanes(e)) for e in edges)
        chunks: list[Polyline] = []
        end, before = 0.0, ""
        for edge in edges:
            lanes, reference = network.edge_lanes(edge), _lane(network, edge, order)
            if before:
                end = self._link(before, edge, end, chunks)
            size = reference.line.length
            self.starts[edge] = end
            for lane in lanes:
                self._enter(lane, end, size / lane.line.length, 1.0)
            others, along = reverse_edges(network, edge)
            parts = [_lane(network, e, order).line.length for e in along]
            whole, behind = sum(parts), sum(parts[: along.index(edge)])
            for lane in (lane for other in others for lane in network.edge_lanes(other)):
                self._enter(lane, end - behind + whole, -whole / lane.line.length, -1.0)
            chunks.append(reference.line)
            end, before = end + size, edge
        self.line = join(chunks)
        self.length = end
        self._upstream(edges[0])

    def _enter(self, lane: Lane, start: float, rate: float, along: float) -> None:
        self._stations.setdefault(lane.index, Station(lane, start, rate, along))

    def _link(self, source: str, target: str, end: float, chunks: list[Polyline]) -> float:
        """The lanes through the junction between two edges; returns where the second one starts."""
        lanes = self._network.lanes
        links = [
            c
            for i in self._network.edges[source].lanes
            for c in self._network.outgoing[i]
            if lanes[c.to_lane].edge == target
        ]
        sizes = [sum(lanes[v].line.length for v in c.via) for c in links]
        size = sizes[0] if sizes else 0.0
        for connection, own in zip(links, sizes, strict=True):
            at = end
            for via in connection.via:
                self._enter(lanes[via], at, size / own, 1.0)
                at += lanes[via].line.length * size / own
        if links:
            chunks.extend(lanes[v].line for v in links[0].via)
        return end + size

    def _upstream(self, first: str) -> None:
        """The last lanes before the first edge: the front may be on the road before the centre is."""
        lanes = self._network.lanes
        for connection in self._network.connections:
            if lanes[connection.to_lane].edge != first:
                continue
            at = 0.0
            for i in (*reversed(connection.via), connection.from_lane):
                at -= lanes[i].line.length
                self._enter(lanes[i], at, 1.0, 1.0)

    def place(self, ego: EgoState) -> float | None:
        """Metres along the road of the ego's centre, whichever way it drives; None where it is on no lane of it."""
        station = self._stations.get(ego.lane)
        return None if station is None else station.start + station.rate * ego.s

    def front(self, ego: EgoState) -> float | None:
        """Metres along the road of the ego's front; None where the ego does not drive along this road."""
        station = self._stations.get(ego.lane)
        if station is not None:
            c = station.along * math.cos(ego.heading - station.line.heading_at(ego.s))
            return station.start + station.rate * ego.s + _HALF_M * c if c > 0.0 else None
        if ego.lane >= 0:
            return None
        x, y = ego.front
        s, d = self.line.project(x, y)
        if abs(d) > self._beside or math.cos(ego.heading - self.line.heading_at(s)) <= 0.0:
            return None
        return s


def _lane(network: RoadNetwork, edge: str, order: int) -> Lane:
    lanes = network.edge_lanes(edge)
    return lanes[max(min(order, len(lanes) - 1), 0)]


class ApproachLine:
    """The end of an approach at its junction, each lane with its own end. beside_widths: as for `Road`."""

    def __init__(self, network: RoadNetwork, edge: str, beside_widths: float) -> None:
        self.lanes = frozenset(network.edges[edge].lanes)
        other = [i for e in reverse_edges(network, edge)[0] for i in network.edges[e].lanes]
        self._line = {i: network.lanes[i].line for i in (*self.lanes, *other)}
        self._beside = beside_widths * sum(lane.width for lane in network.edge_lanes(edge))
        self._reference = network.edge_lanes(edge)[0].line

    def to_go(self, ego: EgoState) -> float | None:
        """Metres from the ego's front to the line, < 0 past it; None where it does not drive towards it."""
        line = self._line.get(ego.lane)
        if line is not None:
            c = math.cos(ego.heading - line.heading_at(ego.s))
            if ego.lane in self.lanes:
                return line.length - ego.s - _HALF_M * c if c > 0.0 else None
            return ego.s + _HALF_M * c if c < 0.0 else None
        if ego.lane >= 0:
            return None
        x, y = ego.front
        s, d = self._reference.project(x, y)
        if abs(d) > self._beside or math.cos(ego.heading - self._reference.heading_at(s)) <= 0.0:
            return None
        return self._reference.length - s
