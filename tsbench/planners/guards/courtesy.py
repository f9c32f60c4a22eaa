"""Right of way at the other junctions on the way, where no sign of the scene speaks: as the network has it.

The way round a prohibited turn leads over several junctions; who drives it has to get through them unhurt.
Units: m, s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from tsbench.maps.network import RoadNetwork
from tsbench.planners.base import Observation, PlannerContext
from tsbench.planners.guards.base import FREE
from tsbench.planners.guards.junction import ways_through
from tsbench.planners.guards.yielding import COURTESY, Yielding
from tsbench.sim.lanegraph import RoutePath
from tsbench.sim.navigation import RouteView

# SUMO's states of a connection that gives way: "m", or "s" after a stop.
_MINOR = "ms"
_LOOK_M = 60.0


@dataclass(frozen=True, slots=True)
class _Junction:
    """A junction on the route where the ego gives way: arc length of its line, approach."""

    line_s: float
    approach: str


class Courtesy:
    """Bounds the acceleration before each such junction; `but`: an approach that a guard looks after."""

    def __init__(self, context: PlannerContext, but: str = "") -> None:
        self._network, self._but = context.network, but
        self._path: RoutePath | None = None
        self._junctions: list[_Junction] = []
        self._next: Yielding | None = None
        self._end = math.inf

    def bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        """What the next junction asks for."""
        if route.path is not self._path:
            self._path, self._next = route.path, None
            self._junctions = _minor(self._network, route.path, self._but)
        if self._next is None:
            while self._junctions and self._junctions[0].line_s < route.s:
                del self._junctions[0]
            if not self._junctions or self._junctions[0].line_s - route.s > _LOOK_M:
                return FREE
            here = self._junctions.pop(0)
            self._end = here.line_s
            others = ways_through(self._network, here.approach)
            self._next = Yielding(self._network, here.approach, (), COURTESY, others)
        least, most = self._next.bounds(observation, route)
        if route.s > self._end:
            self._next = None
        return least, most


def _minor(network: RoadNetwork, path: RoutePath, but: str) -> list[_Junction]:
    """The junctions of a path where its connection gives way, in order."""
    found = []
    for piece, after in zip(path.pieces, path.pieces[1:], strict=False):
        lane = network.lanes[piece.lane]
        if lane.internal or not network.lanes[after.lane].internal or lane.edge == but:
            continue
        states = [c.state for c in network.outgoing[lane.index] if c.via and c.via[0] == after.lane]
        if not states or states[0] not in _MINOR:
            continue
        found.append(_Junction(piece.s1, lane.edge))
    return found
