"""Prohibited and prescribed manoeuvres (3.18, 4.1, 5.7): navigation over a lane graph without them."""

from __future__ import annotations

import math
from collections.abc import Set as AbstractSet

from tsbench.core.errors import InputError
from tsbench.geometry.elementary import U_TURN, turn_class
from tsbench.planners.base import PlannerContext, Privilege
from tsbench.planners.experts.rules.constraint import RuleConstraint
from tsbench.planners.observation import Observation
from tsbench.roads.lane_graph import MapGraph, Turn, heading_change
from tsbench.signs.annotations import SignInstance
from tsbench.signs.rule_kinds import JunctionParams
from tsbench.sim.navigation import Navigator, RouteView


class ManoeuvreConstraint(RuleConstraint):
    """Leads the base planner by a navigator of its own, to the end: so it is never led back into the turn."""

    def __init__(self, context: PlannerContext, privilege: Privilege, sign: SignInstance) -> None:
        self._context, self._sign = context, sign
        self._banned = self.banned(context.graph, privilege, sign)
        self._navigator: Navigator | None = None

    def banned(self, graph: MapGraph, privilege: Privilege, sign: SignInstance) -> frozenset[Turn]:
        """Turns that the way may not hold: those out of the signed approach that the rule does not allow."""
        rule, network = privilege.rule(sign), graph.network
        approach = privilege.view.on_edge(sign.params_as(JunctionParams).approach)[0]
        straight, u_turn = rule.thresholds["straight_deg"], rule.thresholds["u_turn_deg"]
        allowed = rule.options["allowed"]
        return frozenset(
            (approach, target)
            for target in graph.successors(approach)
            if turn_class(math.degrees(heading_change(network, approach, target)), straight, u_turn) not in allowed
        )

    def route(self, observation: Observation) -> RouteView:
        """The shortest way that the sign allows."""
        if self._navigator is None:
            return self._begin(observation)
        return self._navigator.update(observation.ego)

    def _begin(self, observation: Observation) -> RouteView:
        graph, destination = self._context.graph, self._context.destination
        # Turning round in the road is allowed by some signs, but no way to drive if there is another.
        for banned in (self._banned | u_turns(graph), self._banned):
            navigator = Navigator(Without(graph, banned), destination)
            try:
                route = navigator.update(observation.ego)
            except ValueError:
                continue
            self._navigator = navigator
            return route
        raise InputError(f"sign {self._sign.id!r}: no way to edge {destination.edge!r} that it allows")


class Without(MapGraph):
    """A lane graph whose routes never take the given turns."""

    _banned: frozenset[Turn]

    __slots__ = ("_banned",)

    def __init__(self, graph: MapGraph, banned: AbstractSet[Turn]) -> None:
        super().__init__(graph.network)
        object.__setattr__(self, "_banned", frozenset(banned))

    def route(
        self,
        source: str,
        target: str,
        avoid_turns: AbstractSet[Turn] = frozenset(),
        avoid_edges: AbstractSet[str] = frozenset(),
    ) -> tuple[str, ...] | None:
        """As the graph's own, without the banned turns."""
        return super().route(source, target, self._banned | avoid_turns, avoid_edges)


def u_turns(graph: MapGraph) -> frozenset[Turn]:
    """All turns of the network that lead back."""
    edges = (e.id for e in graph.network.edges.values() if not e.internal)
    return frozenset((a, b) for a in edges for b in graph.successors(a) if graph.turn(a, b) == U_TURN)
