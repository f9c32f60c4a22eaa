"""The release of a convoy, or of pedestrians: once, when the first would meet the ego in the conflict zone.

Source: docs/spec/scenes.md, "Junction". The prediction reads the ego's present place and speed
only; planners never see the plan.
"""

from __future__ import annotations

from tsbench.roads.network import RoadNetwork
from tsbench.sim.scene import ReleasePlan, WalkersPlan
from tsbench.sim.world import EGO_LENGTH_M, EgoState

RELEASE_AT_M = 12.0
# Pedestrians: nearer, or who always drives at half speed could wait for them to step out and stop then.
WALKERS_AT_M = 3.0
_ACCEL_MPS2 = 1.5
_BRAKE_MPS2 = 2.0
_STEP_S = 0.2
_LONG_S = 60.0


def predicted_arrival(to_line: float, to_zone: float, speed: float, cruise: float, turn: float) -> float:
    """Seconds until the ego's front has gone `to_zone` metres, at most 60.

    It accelerates to `cruise` and is down at `turn` (m/s) when it reaches the line, `to_line` metres ahead.
    """
    gone, time, v = 0.0, 0.0, speed
    while gone < to_zone and time < _LONG_S:
        room = max(to_line - gone, 0.0)
        cap = (turn * turn + 2.0 * _BRAKE_MPS2 * room) ** 0.5
        v = min(v + _ACCEL_MPS2 * _STEP_S, cruise, max(cap, 0.5))
        gone += v * _STEP_S
        time += _STEP_S
    return time - (gone - to_zone) / max(v, 0.5)


class ConvoyRelease:
    """Decides the moment of release, of vehicles or pedestrians. `update` returns True once, at that tick."""

    def __init__(self, plan: ReleasePlan, network: RoadNetwork) -> None:
        self.plan = plan
        self._network = network
        self._latest_m = WALKERS_AT_M if isinstance(plan, WalkersPlan) else RELEASE_AT_M
        self._until_past = isinstance(plan, WalkersPlan) and plan.until_past
        lane = network.lane(plan.line_lane)
        self._edge = frozenset(network.edges[lane.edge].lanes)
        self._length = lane.line.length
        self._done = False

    def update(self, ego: EgoState) -> bool:
        """Is it time, and was it not before?"""
        if self._done:
            return False
        if self._until_past:
            self._done = self._is_past(ego)
            return self._done
        if ego.lane in self._edge:
            to_line = self._length - ego.s - EGO_LENGTH_M / 2
            if to_line > self._latest_m:
                plan = self.plan
                eta = predicted_arrival(
                    to_line, to_line + plan.ego_zone_m, ego.speed, plan.ego_cruise_mps, plan.ego_turn_mps
                )
                if eta > plan.ahead_s:
                    return False
        self._done = True
        return True

    def _is_past(self, ego: EgoState) -> bool:
        """Is the ego behind the junction that the line leads into?"""
        if ego.lane < 0 or ego.lane in self._edge:
            return False
        return not self._network.edges[self._network.lanes[ego.lane].edge].internal
