"""Giving way at a sign (2.4): the junction and the approaches with priority stand on the plate."""

from __future__ import annotations

from tsbench.planners.base import Observation, PlannerContext, Privilege
from tsbench.planners.guards.junction import ways_from
from tsbench.planners.guards.yielding import Yielding
from tsbench.sim.navigation import RouteView


class GiveWayGuard:
    """Waits for vehicles on the approaches in the plate's `main_in`, with the rule's own thresholds."""

    def __init__(self, context: PlannerContext, privilege: Privilege) -> None:
        params, thresholds = privilege.sign.params, privilege.rule.thresholds
        self._yielding = Yielding(
            context.network,
            params.get("approach", privilege.sign.edge),
            ways_from(context.network, tuple(params["main_in"].split())),
            gap=thresholds["gap_s"],
            least=thresholds["min_foe_speed_mps"],
            post_clear=thresholds["post_clear_s"],
        )

    def guide(self, observation: Observation) -> RouteView:
        """The navigation's own route."""
        return observation.route

    def bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        """What the junction asks for."""
        return self._yielding.bounds(observation, route)
