"""Roundabouts (4.3): the ring's traffic goes first at the entry; on the ring, vehicles that push in elsewhere."""

from __future__ import annotations

from tsbench.planners.base import PlannerContext, Privilege
from tsbench.planners.experts.rules.give_way_constraint import GiveWayConstraint
from tsbench.signs.annotations import SignInstance
from tsbench.signs.rule_kinds import RoundaboutParams


class RoundaboutConstraint(GiveWayConstraint):
    """Gives way to vehicles that come to the entry along the ring, or are about to come onto it before.

    Which way round and where out is the route's business. `alert_edges`: the ring's edges. At their ends the ego
    has right of way, but lets a vehicle go on that has driven in ahead of it.
    """

    def __init__(self, context: PlannerContext, privilege: Privilege, sign: SignInstance) -> None:
        super().__init__(context, privilege, sign)
        self.alert_edges = frozenset(privilege.view.on_edge(edge)[0] for edge in sign.params_as(RoundaboutParams).ring)
