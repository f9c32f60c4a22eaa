"""A junction as an expert sees it: paths with priority, where they meet the ego's own, who comes on them.

A strip is as wide as its lane; arc lengths on a way begin at the end of its approach lane. Units: m, m/s.
"""

from __future__ import annotations

from dataclasses import dataclass

from tsbench.geometry.overlap import ConflictZone, conflict_zone
from tsbench.geometry.polyline import Polyline, join
from tsbench.maps.network import Connection, Lane, RoadNetwork
from tsbench.sim.lanegraph import RoutePath
from tsbench.sim.world import Actors

_BODY_M = 2.4


@dataclass(frozen=True, slots=True)
class Way:
    """One connection's way through the junction."""

    connection: Connection
    source: Lane
    target: Lane
    inner: tuple[Lane, ...]
    line: Polyline
    width: float


@dataclass(frozen=True, slots=True)
class Foe:
    """Who has priority: the way, its front's place on it (< 0 before the line), length, speed, row."""

    way: int
    s: float
    length: float
    speed: float
    row: int


@dataclass(frozen=True, slots=True)
class Passage:
    """The ego's own way through: arc length of its line on its route, zone with each way of the others.

    first: the ways whose vehicles go before the ego, by a plate or by the network's right of way.
    """

    line_s: float
    zones: tuple[ConflictZone | None, ...]
    first: frozenset[int]

    @property
    def end_s(self) -> float:
        """Arc length on the route where the last zone ends."""
        return self.line_s + max((z.a_out for z in self.zones if z is not None), default=0.0)


def ways_from(network: RoadNetwork, edges: tuple[str, ...]) -> tuple[Way, ...]:
    """The ways through the junction from all lanes of some approaches."""
    found = []
    for lane in (lane for edge in edges for lane in network.edge_lanes(edge)):
        for c in network.outgoing[lane.index]:
            inner = tuple(network.lanes[v] for v in c.via)
            if inner:
                line, width = join([v.line for v in inner]), max(v.width for v in inner)
                found.append(Way(c, lane, network.lanes[c.to_lane], inner, line, width))
    return tuple(found)


def ways_through(network: RoadNetwork, approach: str, but: tuple[str, ...] = ()) -> tuple[Way, ...]:
    """The ways through the junction at the end of `approach` from its other approaches, save some."""
    junction, left_out = network.edges[approach].target, {approach, *but}
    edges = (e.id for e in network.edges.values() if e.target == junction and not e.internal)
    return ways_from(network, tuple(e for e in edges if e not in left_out))


def passage(
    network: RoadNetwork, path: RoutePath, approach: str, others: tuple[Way, ...], ruled: int = 0
) -> Passage | None:
    """Where a route passes the junction from `approach`; None where it does not (any more).

    ruled: so many of the others' ways, the first ones, have priority by a plate: there strips are as wide as their
    lanes, as the rule has them, else as wide as bodies with some room.
    """
    last = -1
    for k, piece in enumerate(path.pieces):
        if network.lanes[piece.lane].edge == approach:
            last = k
        elif last >= 0:
            break
    if last < 0:
        return None
    inner = []
    for piece in path.pieces[last + 1 :]:
        lane = network.lanes[piece.lane]
        if not lane.internal:
            break
        inner.append(lane)
    if not inner:
        return None
    line, width = join([v.line for v in inner]), max(v.width for v in inner)
    own = network.outgoing[path.pieces[last].lane]
    prior = next((c.yields_to for c in own if inner[0].index in c.via), frozenset[int]())
    return Passage(
        line_s=path.pieces[last].s1,
        zones=tuple(
            conflict_zone(line, width, w.line, w.width)
            if k < ruled
            else conflict_zone(line, _BODY_M, w.line, _BODY_M)
            for k, w in enumerate(others)
        ),
        first=frozenset(
            k for k, w in enumerate(others) if k < ruled or not prior.isdisjoint(w.connection.via)
        ),
    )


class FoeFinder:
    """Finds who comes, or has come, on one of the ways with priority, by route and lane."""

    def __init__(self, network: RoadNetwork, ways: tuple[Way, ...]) -> None:
        self._network, self._ways = network, ways
        # By vehicle, then by lane: its way and the place of the lane's start on it; settled when first seen.
        self._places: dict[int, dict[int, tuple[int, float]]] = {}

    def find(self, actors: Actors) -> list[Foe]:
        """All of them among the road users of a tick."""
        found = []
        lanes, table = actors.lane.tolist(), actors.table
        for at, row in enumerate(actors.index.tolist()):
            places = self._places.get(row)
            if places is None:
                places = self._places[row] = self._settle(table.routes[row])
            place = places.get(lanes[at])
            if place is not None:
                way, start = place
                s, speed = start + float(actors.lane_s[at]), float(actors.speed[at])
                found.append(Foe(way, s, float(table.length[row]), speed, row))
        return found

    def _settle(self, route: tuple[str, ...]) -> dict[int, tuple[int, float]]:
        places: dict[int, tuple[int, float]] = {}
        lanes = self._network.lanes
        for k in range(len(route) - 1):
            pair = (route[k], route[k + 1])
            mine = [j for j, w in enumerate(self._ways) if (w.source.edge, w.target.edge) == pair]
            if not mine:
                continue
            for lane in self._network.edge_lanes(pair[1]):
                j = min(mine, key=lambda j: abs(self._ways[j].target.order - lane.order))
                places[lane.index] = (j, self._ways[j].line.length)
            for j in mine:
                at = 0.0
                for inner in self._ways[j].inner:
                    places[inner.index] = (j, at)
                    at += inner.line.length
            end, wanted = 0.0, self._wanted(mine, route[k + 2 : k + 3])
            for m in range(k, -1, -1):
                edge = self._network.edges[route[m]]
                for i in edge.lanes:
                    j = min(wanted, key=lambda j: abs(self._ways[j].source.order - lanes[i].order))
                    places[i] = (j, end - lanes[i].line.length)
                end -= edge.length
                if m:
                    end -= self._between(route[m - 1], route[m], end, places)
        return places

    def _wanted(self, mine: list[int], onward: tuple[str, ...]) -> list[int]:
        """Those of a vehicle's possible ways whose lane leads on to where it goes next: it may change over to them."""
        lanes, outgoing = self._network.lanes, self._network.outgoing
        leading = [
            j
            for j in mine
            if any(lanes[c.to_lane].edge in onward for c in outgoing[self._ways[j].target.index])
        ]
        return leading or mine

    def _between(self, source: str, target: str, end: float, places: dict[int, tuple[int, float]]) -> float:
        """Places on the lanes through the junction between two edges upstream; returns its length."""
        lanes, longest = self._network.lanes, 0.0
        for i in self._network.edges[source].lanes:
            for c in self._network.outgoing[i]:
                if lanes[c.to_lane].edge == target:
                    at = end
                    for via in reversed(c.via):
                        at -= lanes[via].line.length
                        places[via] = (places[c.to_lane][0], at)
                    longest = max(longest, end - at)
        return longest
