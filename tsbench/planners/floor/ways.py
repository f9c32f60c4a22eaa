"""The other way: never what navigation takes at the first fork."""

from __future__ import annotations

from collections.abc import Set as AbstractSet

from tsbench.planners.base import Observation, PlannerContext
from tsbench.planners.experts.rules.constraint import RuleConstraint
from tsbench.planners.experts.rules.manoeuvre import Without
from tsbench.roads.lane_graph import Turn
from tsbench.sim.navigation import Navigator, RouteView
from tsbench.sim.world import EgoState


def other_way(context: PlannerContext, ego: EgoState, banned: AbstractSet[Turn]) -> Navigator | None:
    """Navigation without some turns; None where no other way leads to the destination."""
    navigator = Navigator(Without(context.graph, banned), context.destination)
    try:
        navigator.update(ego)
    except ValueError:
        return None
    return navigator


class OtherWay(RuleConstraint):
    """Leads by that navigation, to the end."""

    def __init__(self, navigator: Navigator) -> None:
        self._navigator = navigator

    def route(self, observation: Observation) -> RouteView:
        return self._navigator.update(observation.ego)
