"""The ways on that `plant2-ft` is shown: to the destination, one by each exit of the junction ahead. Units: m, rad.

The navigation shows the shortest way, also where a sign forbids it. Which of the others is permitted the signs say;
which of them lead to the destination, and where their lanes lie, the road map says. Nothing of a sign is read here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from tsbench.geometry.polyline import Polyline
from tsbench.learn.plant2 import layout as at
from tsbench.learn.plant2.tokens import Pose, points_ahead
from tsbench.planners.base import Observation
from tsbench.roads.lane_graph import Destination, MapGraph, RoutePath, heading_change

_WINDOW_M = 15.0
# A plan that is so much nearer to another way means that one: less is a wide or a cut corner.
_MEANT_M = 1.0
_MOST_REMAINING_M = 1000.0


@dataclass(slots=True, eq=False)
class Way:
    """A way by one exit. s: where the ego is on it; exit_s: where it leaves the edge; turn: change of heading there."""

    edges: tuple[str, ...]
    line: Polyline
    s: float
    exit_s: float
    end_s: float
    turn: float
    shown: bool


class RouteAlternatives:
    """Ways of one episode; found anew on each ordinary lane that the ego comes to, and kept inside junctions."""

    def __init__(self, graph: MapGraph, destination: Destination) -> None:
        self._graph, self._destination = graph, destination
        self._lane = -1
        self._onward: dict[str, tuple[str, ...] | None] = {}
        self.ways: list[Way] = []
        self._intended: Way | None = None

    def watch(self, o: Observation) -> None:
        """Follow the ego: at every tick, in order; a second call at a tick changes nothing."""
        ego = o.ego
        if ego.lane not in (-1, self._lane) and not self._graph.network.lanes[ego.lane].internal:
            self._lane = ego.lane
            found = list(self._from(ego.lane, ego.s, o.route.path))
            # Shorter ones first: where a junction has more exits than there are slots, the longest ways are left out.
            self.ways = sorted(found, key=lambda way: way.end_s)[: at.WAYS]
            self._intended = next((way for way in self.ways if way.shown), None)
        for way in self.ways:
            way.s = way.line.project(ego.x, ego.y, way.s - _WINDOW_M, way.s + _WINDOW_M)[0]

    def intent(self, x: float, y: float, ahead: float) -> tuple[str, ...]:
        """Edges of the way that a plan follows: it leads to a point (world, m) `ahead` metres from here.

        () for the navigation's way, and where that is not among the ways. Where ways run together, the plan keeps its
        earlier way.
        """
        if self._intended is None:
            return ()
        # Before the exit ways differ by lane, and a lane is no turn.
        aside = {
            way: abs(way.line.project(x, y, way.s, way.s + ahead + _WINDOW_M)[1])
            for way in self.ways
            if way.exit_s < way.s + ahead
        }
        nearest = min(aside, key=aside.__getitem__, default=self._intended)
        if self._intended in aside and aside[nearest] < aside[self._intended] - _MEANT_M:
            self._intended = nearest
        return () if self._intended.shown else self._intended.edges

    def fill(self, record: at.Record, pose: Pose) -> None:
        """Write `ways` and `way_known` as seen from a pose; after `watch`."""
        for k, way in enumerate(self.ways):
            points = points_ahead(way.line, way.s, at.WAY_AHEAD_M, pose)
            record["way_known"][k] = 1
            record["ways"][k, : -at.WAY_FACTS] = (points / at.POSITION_SCALE_M).ravel()
            onward, left = ((way.exit_s - way.s) / at.POSITION_SCALE_M, min(way.end_s - way.s, _MOST_REMAINING_M))
            facts = (math.cos(way.turn), math.sin(way.turn), onward, left / at.REMAINING_SCALE_M, way.shown)
            record["ways"][k, -at.WAY_FACTS :] = facts

    def _from(self, lane: int, s: float, route: RoutePath) -> Iterator[Way]:
        edge, last = self._graph.edge_of(lane), self._destination.edge
        if edge == last:
            path = self._graph.path((edge,), lane, s, self._destination)
            if path is not None:
                yield Way(path.edges, path.line, 0.0, path.destination_s, path.destination_s, 0.0, True)
            return
        after = dict(zip(route.edges, route.edges[1:], strict=False)).get(edge)
        for exit_ in self._graph.successors(edge):
            onward = self._route(exit_)
            path = None if onward is None else self._graph.path((edge, *onward), lane, s, self._destination)
            if path is None:
                continue
            turn = heading_change(self._graph.network, edge, exit_)
            exit_s, shown = self._exit_s(path, edge), exit_ == after
            yield Way(path.edges, path.line, 0.0, exit_s, path.destination_s, turn, shown)

    def _route(self, edge: str) -> tuple[str, ...] | None:
        if edge not in self._onward:
            self._onward[edge] = self._graph.route(edge, self._destination.edge)
        return self._onward[edge]

    def _exit_s(self, path: RoutePath, edge: str) -> float:
        end = 0.0
        for piece in path.pieces:
            if self._graph.edge_of(piece.lane) != edge:
                break
            end = piece.s1
        return end
