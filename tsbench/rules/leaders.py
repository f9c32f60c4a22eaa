"""Vehicles ahead of the ego on its lane, and on those that this one leads into. Units: m, m/s."""

from __future__ import annotations

from collections.abc import Iterator

from tsbench.roads.network import RoadNetwork
from tsbench.sim.world import EGO_LENGTH_M, WorldSnapshot


class Leaders:
    """Finds them, tick by tick."""

    def __init__(self, network: RoadNetwork) -> None:
        self._network = network
        self._next: dict[int, dict[int, float]] = {}

    def within(self, snapshot: WorldSnapshot, reach: float) -> Iterator[tuple[float, float]]:
        """Gap from the ego's front to the other's rear, and its speed, of each within `reach`."""
        ego, actors = snapshot.ego, snapshot.actors
        ahead = self._ahead(ego.lane)
        for k, lane in enumerate(actors.lane.tolist()):
            if lane in ahead:
                rear = ahead[lane] + float(actors.lane_s[k]) - float(actors.length[k])
                gap = rear - ego.s - EGO_LENGTH_M / 2
                if -EGO_LENGTH_M <= gap <= reach:
                    yield gap, float(actors.speed[k])

    def _ahead(self, lane: int) -> dict[int, float]:
        """The ego's lane and those that it leads into: where each starts, m from the first one's start."""
        found = self._next.get(lane)
        if found is None:
            # Pedestrians, too, are on no lane.
            found = self._next[lane] = {lane: 0.0} if lane >= 0 else {}
            network = self._network
            for connection in network.outgoing[lane] if lane >= 0 else ():
                at = network.lanes[lane].length
                for i in (*connection.via, connection.to_lane):
                    found.setdefault(i, at)
                    at += network.lanes[i].length
        return found
