"""Right of way at the other junctions on the way, where no sign of the scene speaks: as the network has it.

The way round a prohibited turn leads over several junctions, which the ego has to pass unhurt.
Units: m, s.
"""

from __future__ import annotations

from collections.abc import Set as AbstractSet
from dataclasses import dataclass

from tsbench.planners.base import Observation, Privilege
from tsbench.planners.experts.rules.conflict_check import GapRequirement
from tsbench.planners.experts.rules.constraint import FREE
from tsbench.planners.experts.rules.gap_acceptance import COURTESY, Yielding
from tsbench.planners.experts.rules.way_through import paths_through
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.planner_map import PlannerMap
from tsbench.sim.navigation import RouteView

# SUMO's states of a connection that gives way: "m", or "s" after a stop.
_MINOR = "ms"
_LOOK_M = 60.0


@dataclass(frozen=True, slots=True)
class _Junction:
    """A junction on the route where the ego gives way: arc length of its line, approach (SUMO's edge)."""

    line_s: float
    approach: str


class RightOfWay:
    """Bounds the acceleration before each such junction; `but`: approaches (on the map) that constraints look after.

    alert_edges: those at whose end the ego has right of way, and looks out all the same for vehicles in the junction.
    demand: what is asked before the ego goes in front of a vehicle with right of way.
    """

    def __init__(
        self,
        privilege: Privilege,
        but: AbstractSet[str] = frozenset(),
        alert_edges: AbstractSet[str] = frozenset(),
        demand: GapRequirement = COURTESY,
    ) -> None:
        self._privilege, self._but, self._alert = privilege, but, alert_edges
        self._demand = demand
        self._path: RoutePath | None = None
        self._junctions: list[_Junction] = []
        self._near: list[Yielding] = []

    def acceleration_bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        """What the junctions ahead ask for, each until the ego has left it."""
        if route.path is not self._path:
            self._path, self._near = route.path, []
            self._junctions = _minor(self._privilege.view, route.path, self._but, self._alert)
            while self._junctions and self._junctions[0].line_s < route.s:
                del self._junctions[0]
        while self._junctions and self._junctions[0].line_s - route.s <= _LOOK_M:
            approach = self._junctions.pop(0).approach
            others = paths_through(self._privilege.network, approach)
            self._near.append(Yielding(self._privilege, approach, (), self._demand, others, self._demand))
        if not self._near:
            return FREE
        asked = [junction.acceleration_bounds(observation, route) for junction in self._near]
        self._near = [junction for junction in self._near if not junction.passed(route)]
        return max(least for least, _ in asked), min(most for _, most in asked)


def _minor(view: PlannerMap, path: RoutePath, but: AbstractSet[str], alert_edges: AbstractSet[str]) -> list[_Junction]:
    """The junctions of a path where its connection gives way, and those at the end of `alert_edges` edges, in order."""
    found = []
    for piece, after in zip(path.pieces, path.pieces[1:], strict=False):
        lane, link = view.map.lanes[piece.lane], view.crossed.get(after.lane)
        if link is None or lane.edge in but or (link.state not in _MINOR and lane.edge not in alert_edges):
            continue
        found.append(_Junction(piece.s1, view.chains[lane.edge][-1]))
    return found
