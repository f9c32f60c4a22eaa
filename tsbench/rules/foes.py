"""Where vehicles with priority are on their way through the junction: from lane, place, route. Units: m."""

from __future__ import annotations

from typing import NamedTuple

from tsbench.maps.network import RoadNetwork
from tsbench.rules.paths import JunctionPath
from tsbench.sim.world import Actors, ActorTable

# Farther upstream than a snapshot reaches.
_UPSTREAM_M = 150.0


class Foe(NamedTuple):
    """A vehicle with priority at one tick.

    at: its place in `Actors`. row: in the table. path: which path it takes. s: its front's place on that
    path, negative before its line. length: m. speed: m/s.
    """

    at: int
    row: int
    path: int
    s: float
    length: float
    speed: float


# On a lane: path, the path's coordinate of the lane's start, geometric metres per SUMO metre.
Place = tuple[int, float, float]


class FoeFinder:
    """Finds the vehicles that come, or have come, through the junction on one of the given paths.

    A vehicle's way is settled when it is first seen: its route does not change.
    """

    def __init__(self, network: RoadNetwork, paths: tuple[JunctionPath, ...]) -> None:
        self._network = network
        self._paths = paths
        self._plans: dict[int, dict[int, Place]] = {}

    def find(self, actors: Actors) -> list[Foe]:
        """The vehicles with priority among the road users of a tick, in their order."""
        found = []
        plans, table = self._plans, actors.table
        rows, lanes = actors.index.tolist(), actors.lane.tolist()
        places, speeds = actors.lane_s.tolist(), actors.speed.tolist()
        for at, row in enumerate(rows):
            plan = plans.get(row)
            if plan is None:
                plan = plans[row] = self._plan(table, row)
            place = plan.get(lanes[at])
            if place is not None:
                path, start, scale = place
                s = start + scale * places[at]
                found.append(Foe(at, row, path, s, float(table.length[row]), speeds[at]))
        return found

    def _plan(self, table: ActorTable, row: int) -> dict[int, Place]:
        """For each lane of the vehicle's way near the junction, its place on its path."""
        route, plan = table.routes[row], {}
        for k in range(len(route) - 1):
            ways = [j for j, p in enumerate(self._paths) if (p.source, p.target) == (route[k], route[k + 1])]
            if ways:
                plan.update(self._through(ways, route[: k + 1]))
        return plan

    def _through(self, ways: list[int], upstream: tuple[str, ...]) -> dict[int, Place]:
        """Places for one passage: through by any of `ways`, having come over the edges `upstream`."""
        network, plan = self._network, dict[int, Place]()
        by_from = {self._paths[j].connection.from_lane: j for j in ways}
        by_to = {self._paths[j].connection.to_lane: j for j in ways}
        for lane in network.edges[self._paths[ways[0]].target].lanes:
            j = self._nearest(by_to, lane)
            plan[lane] = (j, self._paths[j].line.length, self._scale(lane))
        for j in ways:
            at = 0.0
            for via in self._paths[j].connection.via:
                plan[via] = (j, at, self._scale(via))
                at += network.lanes[via].line.length
        end = 0.0
        for k in range(len(upstream) - 1, -1, -1):
            lanes = network.edges[upstream[k]].lanes
            for lane in lanes:
                plan[lane] = (
                    self._nearest(by_from, lane),
                    end - network.lanes[lane].line.length,
                    self._scale(lane),
                )
            end -= network.lanes[lanes[0]].line.length
            if k == 0 or end < -_UPSTREAM_M:
                break
            end = self._before(upstream[k - 1], upstream[k], end, by_from, plan)
        return plan

    def _before(
        self, source: str, target: str, end: float, by_from: dict[int, int], plan: dict[int, Place]
    ) -> float:
        """Places on the internal lanes between two upstream edges; returns where `source` ends."""
        lanes, start = self._network.lanes, end
        for lane in self._network.edges[source].lanes:
            for connection in self._network.outgoing[lane]:
                if lanes[connection.to_lane].edge != target:
                    continue
                at = end
                for via in reversed(connection.via):
                    at -= lanes[via].line.length
                    plan[via] = (self._nearest(by_from, connection.to_lane), at, self._scale(via))
                start = at
        return start

    def _nearest(self, by_lane: dict[int, int], lane: int) -> int:
        """The path of this lane, or of the lane whose place in its edge is nearest."""
        order = self._network.lanes[lane].order
        return by_lane[min(by_lane, key=lambda i: (i != lane, abs(self._network.lanes[i].order - order), i))]

    def _scale(self, lane: int) -> float:
        """Geometric metres per metre of SUMO's lane length."""
        one = self._network.lanes[lane]
        return one.line.length / one.length if one.length > 0.0 else 1.0
