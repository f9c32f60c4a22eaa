"""Navigation: the way to the destination from where the ego is, re-routed as soon as the ego has left it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tsbench.roads.lane_graph import Destination, MapGraph, RoutePath
from tsbench.sim.world import EgoState

_WINDOW_M = 15.0
_OTHER_LANE_SHARE = 0.6


@dataclass(frozen=True, slots=True)
class RouteView:
    """The navigation hint at one tick.

    path: reference line to the destination; the same object as long as the route stands. s, d: the ego centre's
    Frenet place on it (m, left positive). remaining: m to the destination along it (inf: no way from here).
    """

    path: RoutePath
    s: float
    d: float
    remaining: float


class Navigator:
    """Holds the route of one episode. The route is the shortest way; signs are no business of navigation."""

    def __init__(self, graph: MapGraph, destination: Destination) -> None:
        self.graph = graph
        self.destination = destination
        self._path: RoutePath | None = None
        self._s = 0.0
        self._lost = False
        self._edges: frozenset[str] = frozenset()
        self._lane = -1

    def update(self, ego: EgoState) -> RouteView:
        """The route as of this tick. Raises ValueError if there is no route at the very start."""
        if self._path is None or self._left_route(ego):
            self._replan(ego)
        path = self._path
        assert path is not None
        s, d = path.line.project(ego.x, ego.y, self._s - _WINDOW_M, self._s + _WINDOW_M)
        self._s = s
        remaining = math.inf if self._lost else max(path.destination_s - s, 0.0)
        return RouteView(path, s, d, remaining)

    def _left_route(self, ego: EgoState) -> bool:
        """Has the ego come onto another lane than the one it was routed on?"""
        assert self._path is not None
        if ego.lane < 0 or ego.lane == self._lane:
            return False
        lane = self.graph.network.lanes[ego.lane]
        self._lane = ego.lane
        if self._lost:
            # From any lane but the one without a way there may be one again, back on the old route above all.
            return True
        s, d = self._path.line.project(ego.x, ego.y, self._s - _WINDOW_M, self._s + _WINDOW_M)
        ahead = {p.lane for p in self._path.pieces if p.s0 - 1.0 <= s <= p.s1 + 1.0}
        if lane.internal:
            return ego.lane not in ahead and abs(d) > _OTHER_LANE_SHARE * lane.width
        return self.graph.edge_of(ego.lane) not in self._edges or abs(d) > _OTHER_LANE_SHARE * lane.width

    def _replan(self, ego: EgoState) -> None:
        first = self._path is None
        if ego.lane >= 0:
            self._lane = ego.lane
            path = self._from_lane(ego.lane, ego.s)
            if path is not None:
                self._path, self._s, self._lost = path, 0.0, False
                self._edges = frozenset(path.edges)
                return
        if first:
            raise ValueError(f"no route from the start to edge {self.destination.edge}")
        self._lost = True

    def _from_lane(self, lane: int, s: float) -> RoutePath | None:
        network = self.graph.network
        edge = self.graph.edge_of(lane)
        if network.lanes[lane].internal:
            onward = [c.to_lane for c in network.connections if lane in c.via]
            if not onward:
                return None
            edge = network.lanes[onward[0]].edge
        # Already past the destination on its own edge: the way back is round the block, not a U-turn on the spot.
        route = self.graph.route(edge, self.destination.edge)
        return None if route is None else self.graph.path(route, lane, s, self.destination)
