"""Giving way at a sign: the junction and the approaches with priority stand on the plate."""

from __future__ import annotations

from tsbench.planners.base import PlannerContext, Privilege
from tsbench.planners.experts.rules.conflict_check import GapRequirement, paths_through
from tsbench.planners.experts.rules.constraint import RuleConstraint
from tsbench.planners.experts.rules.gap_acceptance import Yielding
from tsbench.planners.observation import Observation
from tsbench.roads.junction_paths import junction_paths
from tsbench.signs.annotations import SignInstance
from tsbench.signs.rule_kinds import GiveWayParams
from tsbench.sim.navigation import RouteView


class GiveWayConstraint(RuleConstraint):
    """Waits for vehicles on the approaches in the plate's `main_in`, with the rule's own thresholds.

    Other vehicles with right of way over the ego in this junction (it turns left in front of the arm opposite) are
    let pass too, as at any other junction. `approach`: the edge from which this looks after the junction.
    """

    def __init__(self, context: PlannerContext, privilege: Privilege, sign: SignInstance) -> None:  # noqa: ARG002
        params, thresholds = sign.params_as(GiveWayParams), privilege.rule(sign).thresholds
        network = privilege.network
        self.approach = privilege.view.on_edge(params.approach)[0]
        self.yielding = Yielding(
            privilege,
            params.approach,
            junction_paths(network, params.main_in),
            GapRequirement(thresholds["gap_s"], thresholds["min_foe_speed_mps"], thresholds["post_clear_s"]),
            paths_through(network, params.approach, params.main_in),
        )

    def acceleration_bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        """What the junction asks for."""
        return self.yielding.acceleration_bounds(observation, route)
