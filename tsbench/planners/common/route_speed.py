"""What a route allows at a place on it, for planners that learn: limit, and speed in its bends. Units: m, m/s."""

from __future__ import annotations

import math

import numpy as np

from tsbench.planners.common.speed_profile import PathSamples, speed_at, speed_profile
from tsbench.roads.lane_graph import RoutePath
from tsbench.sim.navigation import RouteView

_LATERAL_MPS2, _DECEL_MPS2 = 2.2, 2.0
_PREVIEW_S = 0.5
_KEPT = 4


class RouteSpeed:
    """Prepared once per path: a few are kept, as an expert's guard and the navigation may take turns."""

    def __init__(self) -> None:
        self._known: list[tuple[RoutePath, list[float], list[float]]] = []

    def limit(self, route: RouteView) -> float:
        """The road's own limit."""
        limits = self._at(route.path)[2]
        return limits[min(max(int(route.s), 0), len(limits) - 1)]

    def allowed(self, route: RouteView, speed: float) -> float:
        """Greatest speed half a second ahead at `speed`: limit, bends, and braking for what comes."""
        return speed_at(self._at(route.path)[1], route.s + _PREVIEW_S * speed)

    def _at(self, path: RoutePath) -> tuple[RoutePath, list[float], list[float]]:
        for entry in self._known:
            if entry[0] is path:
                return entry
        samples = PathSamples(path)
        speeds = speed_profile(
            path, samples, lateral=_LATERAL_MPS2, decel=_DECEL_MPS2, factor=1.0, top=math.inf
        )
        middle = np.arange(samples.last + 1) + 0.5
        piece = np.maximum(np.searchsorted(path.limit_s, middle, side="right") - 1, 0)
        entry = (path, speeds, path.limit[piece].tolist())
        self._known = [entry, *self._known[: _KEPT - 1]]
        return entry
