"""Lane keeping by pure pursuit (Coulter 1992) along a route. Units: m, m/s, rad."""

from __future__ import annotations

from tsbench.planners.base import Observation
from tsbench.sim.ego import pursue
from tsbench.sim.navigation import RouteView
from tsbench.sim.world import EgoState

# Shortest look-ahead: what still damps at walking pace; longer ones cut junction turns of 4 m radius.
LEAST_AHEAD_M = 2.0
AHEAD_S = 0.4


def follow(route: RouteView, ego: EgoState) -> float:
    """Steering angle (rad) that keeps the ego on the path of its route."""
    target = route.s + max(LEAST_AHEAD_M, AHEAD_S * ego.speed)
    tx, ty = route.path.line.point_at(target)
    return pursue(ego.x, ego.y, ego.heading, tx, ty)


def pursue_route(observation: Observation) -> float:
    """Steering angle (rad) that keeps the ego on its route: for planners that only choose a speed."""
    return follow(observation.route, observation.ego)
