"""Is there room on the lane beside? Units: m, s, m/s."""

from __future__ import annotations

from tsbench.planners.base import Observation
from tsbench.planners.common.swept_path import HALF_LENGTH_M
from tsbench.roads.road_map import MapLane

_LEAST_AHEAD_M = 3.0
_LEAST_BEHIND_M = 4.0
_REACTION_S = 1.0
_EASY_BRAKE_MPS2 = 2.0
_ASIDE_M = 0.3


def gap_free(observation: Observation, lane: MapLane) -> bool:
    """Could the ego be on `lane` beside where it is now without anybody having to brake hard?"""
    ego, actors, line = observation.ego, observation.actors, lane.line
    here, _ = line.project(ego.x, ego.y)
    lengths, widths = actors.length.tolist(), actors.width.tolist()
    for k, (x, y, _) in enumerate(actors.pose.tolist()):
        s, d = line.project(x, y)
        if abs(d) > 0.5 * (lane.width + widths[k]) - _ASIDE_M:
            continue
        speed = float(actors.speed[k])
        apart = abs(s - here) - HALF_LENGTH_M - 0.5 * lengths[k]
        if s >= here:
            needed = _LEAST_AHEAD_M + _to_brake(ego.speed, speed)
        else:
            needed = _LEAST_BEHIND_M + _to_brake(speed, ego.speed)
        if apart < needed:
            return False
    return True


def _to_brake(behind: float, ahead: float) -> float:
    """Way that the one behind gains on the one ahead before it is as slow: reaction, then easy braking."""
    closing = behind - ahead
    return max(closing * _REACTION_S + closing * closing / (2.0 * _EASY_BRAKE_MPS2), 0.0)
