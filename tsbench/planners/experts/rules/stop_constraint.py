"""Stop (2.5): a full stop before the line, with traffic or without; then as at any sign that asks to give way."""

from __future__ import annotations

from tsbench.planners.base import PlannerContext, Privilege
from tsbench.planners.experts.rules.constraint import slow_to
from tsbench.planners.experts.rules.give_way_constraint import GiveWayConstraint
from tsbench.planners.observation import Observation
from tsbench.signs.annotations import SignInstance
from tsbench.sim.navigation import RouteView

_HOLD_M = 1.0
_BRAKE_MPS2 = 2.2
# Of the rule's own bounds: how much of the way before the line, and of the speed, counts as a stop for sure.
_SURE = 0.5


class StopConstraint(GiveWayConstraint):
    """Stops well within the rule's window, once on each approach; giving way may keep it standing."""

    def __init__(self, context: PlannerContext, privilege: Privilege, sign: SignInstance) -> None:
        super().__init__(context, privilege, sign)
        thresholds = privilege.rule(sign).thresholds
        self._within = _SURE * thresholds["stop_within_m"]
        self._speed = _SURE * thresholds["stop_speed_mps"]
        self._stopped = False

    def acceleration_bounds(self, observation: Observation, route: RouteView) -> tuple[float, float]:
        """What the line asks for, then the junction."""
        least, most = super().acceleration_bounds(observation, route)
        to_go, v = self.yielding.to_line(route), observation.ego.speed
        if to_go is None or to_go < 0.0:
            return least, most
        self._stopped = to_go <= self._within and (self._stopped or v <= self._speed)
        return least, most if self._stopped else min(most, slow_to(v, 0.0, to_go - _HOLD_M, _BRAKE_MPS2))
