"""From a plan to a command: PD control on path and speed. Units: m, s, m/s, rad.

There is no integral part: the vehicle does exactly what it is told, so that nothing is left over to integrate, and
without it a plan and the ego's state give the command, whatever was before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from tsbench.geometry.polyline import Array
from tsbench.planners.base import Control
from tsbench.sim.ego import pursue
from tsbench.sim.world import EgoState


@dataclass(frozen=True, slots=True)
class Gains:
    """speed_p (1/s), speed_d (-): on speed and acceleration; yaw_d (s): on the yaw rate that the path does not ask for.

    ahead_s, ahead_m: where on the path is steered for. most, least: m/s2. halt: a slower target (m/s) is a halt.
    """

    speed_p: float = 1.5
    speed_d: float = 0.1
    yaw_d: float = 0.02
    ahead_s: float = 0.4
    ahead_m: float = 2.0
    most: float = 2.5
    least: float = -6.0
    halt: float = 0.4


def control(path: Array, speed: float, ego: EgoState, gains: Gains, driven: float = 0.0) -> Control:
    """The command for a path ((k, 2) m in the ego's frame, one point each metre) and a target speed (m/s).

    driven: metres since the place that the path begins at.
    """
    target_speed = 0.0 if speed < gains.halt else speed
    acceleration = gains.speed_p * (target_speed - ego.speed) - gains.speed_d * ego.acceleration
    ahead = max(gains.ahead_m, gains.ahead_s * ego.speed)
    place = min(driven + ahead, float(len(path))) - 1.0
    k = min(int(place), len(path) - 2)
    share = place - k
    tx = float(path[k, 0] + share * (path[k + 1, 0] - path[k, 0]))
    ty = float(path[k, 1] + share * (path[k + 1, 1] - path[k, 1]))
    steering = pursue(0.0, 0.0, 0.0, tx, ty) if math.hypot(tx, ty) > 0.5 else 0.0
    asked = 2.0 * math.sin(math.atan2(ty, max(tx, 0.1))) / max(math.hypot(tx, ty), 1.0) * ego.speed
    steering -= gains.yaw_d * (ego.yaw_rate - asked)
    return Control(min(max(acceleration, gains.least), gains.most), steering)
