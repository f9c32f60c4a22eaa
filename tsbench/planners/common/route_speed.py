"""What a route allows at a place on it, for planners that learn: limit, and speed in its bends. Units: m, m/s."""

from __future__ import annotations

import math

import numpy as np

from tsbench.planners.common.recent import Recent
from tsbench.planners.common.speed_profile import PathSamples, speed_at, speed_profile
from tsbench.roads.lane_graph import RoutePath
from tsbench.sim.navigation import RouteView

_LATERAL_MPS2, _DECEL_MPS2 = 2.2, 2.0
_PREVIEW_S = 0.5


class RouteSpeed:
    """Prepared once per path: a few are kept, as an expert's constraint and the navigation may take turns."""

    def __init__(self) -> None:
        self._of: Recent[RoutePath, tuple[list[float], list[float]]] = Recent(_limits_and_speeds)

    def limit(self, route: RouteView) -> float:
        limits = self._of(route.path)[0]
        return limits[min(max(int(route.s), 0), len(limits) - 1)]

    def allowed(self, route: RouteView, speed: float) -> float:
        """Greatest speed half a second ahead at `speed`: limit, bends, and braking for what comes."""
        return speed_at(self._of(route.path)[1], route.s + _PREVIEW_S * speed)


def _limits_and_speeds(path: RoutePath) -> tuple[list[float], list[float]]:
    """The limit between each metre and the next, and the speed profile."""
    samples = PathSamples(path)
    speeds = speed_profile(path, samples, lateral=_LATERAL_MPS2, decel=_DECEL_MPS2, factor=1.0, top=math.inf)
    middle = np.arange(samples.last + 1) + 0.5
    piece = np.maximum(np.searchsorted(path.limit_s, middle, side="right") - 1, 0)
    return path.limit[piece].tolist(), speeds
