"""Whose traffic a plate addresses, told in relation to the ego: what its place alone does not say."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tsbench.planners.base import Observation, PlannerContext

# one_lane: 1 where it addresses one lane, and not all of its edge. lanes_left: by how many lanes that lane lies to the
# left of the ego's, counted from the kerb on, 0 without one. on_route: 1 where its edge is on the navigation's way.
ADDRESSED = ("one_lane", "lanes_left", "on_route")


class AddressedLanes:
    """Remembers the ego's lane through junctions, where lanes are not counted; make one per environment."""

    def reset(self, context: PlannerContext) -> None:
        """An episode begins."""
        self._graph = context.graph
        self._order = 0

    def __call__(self, o: Observation) -> npt.NDArray[np.float64]:
        """(plates, 3), a row per plate in sight, as `ADDRESSED`; a masked plate has zeros."""
        lane = o.ego.lane
        if lane >= 0 and not self._graph.network.lanes[lane].internal:
            self._order = self._graph.order_of(lane)
        way = o.route.path.edges
        rows = [
            (float(p.lane >= 0), float(p.lane - self._order) if p.lane >= 0 else 0.0, float(p.edge in way))
            for p in o.signs
        ]
        return np.array(rows).reshape(-1, len(ADDRESSED))
