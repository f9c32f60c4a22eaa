"""No entry (3.1): navigation over a lane graph in which nothing leads into the closed edge."""

from __future__ import annotations

from tsbench.planners.base import Privilege
from tsbench.planners.experts.rules.manoeuvre_constraint import ManoeuvreConstraint
from tsbench.roads.lane_graph import MapGraph, Turn
from tsbench.signs.annotations import SignInstance


class NoEntryConstraint(ManoeuvreConstraint):
    """Leads the base planner round the edge that the plate stands on."""

    def banned(self, graph: MapGraph, privilege: Privilege, sign: SignInstance) -> frozenset[Turn]:
        """All turns into the closed edge."""
        closed = privilege.view.on_edge(sign.edge)[0]
        return frozenset((edge, closed) for edge in graph.network.edges if closed in graph.successors(edge))
