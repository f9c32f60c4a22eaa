"""What a rule's constraint is: it says which way to go and how hard to accelerate at most. Units: m, m/s, m/s2."""

from __future__ import annotations

import math
from collections.abc import Set as AbstractSet

from tsbench.planners.observation import Observation
from tsbench.sim.navigation import RouteView

FREE = (-math.inf, math.inf)

_GENTLE_MPS2 = 1.5
_SETTLE_S = 0.3
_AT_POINT_M = 0.05
_FAR = 0.1


class RuleConstraint:
    """Watches over one rule for one episode; asked once a tick, `route` first.

    Made of a `PlannerContext`, a `Privilege` and one of its signs. approach: the edge from which it looks after a
    junction itself, "" for none. alert_edges: those at whose end the network's right of way is not enough.
    """

    approach: str = ""
    alert_edges: AbstractSet[str] = frozenset()

    def route(self, observation: Observation) -> RouteView:
        """The route for the base planner; the navigation's own where the rule wants no other."""
        return observation.route

    def acceleration_bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        """Least and greatest acceleration that the rule leaves at this tick."""
        del observation, route
        return FREE


def slow_to(v: float, target: float, distance: float, comfortable: float) -> float:
    """The greatest acceleration with which `target` speed is still reached within `distance` m.

    Sets in gradually as the braking that it takes comes near `comfortable`; asks for all that it takes from
    there on.
    """
    if distance <= _AT_POINT_M:
        return (target - v) / _SETTLE_S
    if v <= target:
        return math.inf
    needed = (v * v - target * target) / (2.0 * distance)
    share = needed / comfortable
    if share < _FAR:
        return math.inf
    return -needed if share >= 1.0 else (1.0 - share) * _GENTLE_MPS2 - share * needed
