"""Whose traffic a plate addresses, told in relation to the ego: what its place alone does not say."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from tsbench.planners.base import Observation, PlannerContext, SignView

# one_lane: 1 where it addresses one lane, and not all of its edge. lanes_left: by how many lanes that lane lies to the
# left of the ego's, counted from the kerb on, 0 without one. on_route: 1 where its edge is on the navigation's way.
ADDRESSED = ("one_lane", "lanes_left", "on_route")
# The two directions of the plate 8.13, against the approach's own; zeros where none hangs there.
MAIN_ROAD = ("main_cos_1", "main_sin_1", "main_cos_2", "main_sin_2")


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


def main_road(plate: SignView) -> tuple[float, ...]:
    """As `MAIN_ROAD`."""
    if not plate.main_road:
        return (0.0,) * len(MAIN_ROAD)
    return tuple(part(angle) for angle in plate.main_road for part in (math.cos, math.sin))
