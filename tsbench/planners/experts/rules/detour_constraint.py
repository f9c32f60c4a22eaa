"""Passing an obstacle on a side that the plate allows (4.2)."""

from __future__ import annotations

from tsbench.planners.base import PlannerContext, Privilege
from tsbench.planners.experts.rules.obstacle_pass import ObstaclePass
from tsbench.signs.annotations import SignInstance
from tsbench.signs.rule_kinds import ObstacleParams


class DetourConstraint(ObstaclePass):
    """Leads the base planner past the plate's obstacle."""

    def __init__(self, context: PlannerContext, privilege: Privilege, sign: SignInstance) -> None:
        obstacle = sign.params_as(ObstacleParams).obstacle
        super().__init__(context, obstacle, privilege.rule(sign).options["allowed_sides"])
