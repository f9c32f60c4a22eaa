"""From two numbers in -1..1, which a network learns, to a command. Units: m, m/s, rad.

`aim` is what `ppo` and `carl` learn: the first number is the acceleration, the second how far beside the route the ego
aims. 0, 0 rolls on along the route, so that learning begins with driving and not with staying on the road. The place
aimed at enters squared, which makes small corrections fine, and lies at most a third of the look-ahead beside the
present one, which keeps swerves smooth at every speed. Both numbers hold for several ticks; the steering that they mean
is computed at each tick.
`steer` is the plain vehicle: the second number is the steering angle.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from tsbench.planners.base import Control, Observation
from tsbench.sim.ego import MAX_STEER_RAD, pursue

Act = Callable[[float, float, Observation], Control]

# Ticks that an action of `ppo` and `carl` holds: 0.3 s.
HOLD_TICKS = 3

_ACCEL_MPS2, _BRAKE_MPS2 = 2.4, 5.0
_ASIDE_M = 3.5
_ON_LINE_M = 0.5
_SLOPE = 1.0 / 3.0
_LEAST_AHEAD_M, _AHEAD_S = 2.0, 0.4
_LEAST_SWERVE_M, _SWERVE_S = 5.0, 0.9


def accelerate(value: float) -> float:
    """Acceleration (m/s2): up to 2.4 forwards (nuPlan's comfort bound), up to 5 in braking.

    Around 0 both ways are alike, so that what is learned with noise is what is driven without; hard braking is steeper.
    """
    value = min(max(value, -1.0), 1.0)
    return _ACCEL_MPS2 * value if value >= 0.0 else value * (_ACCEL_MPS2 - (_BRAKE_MPS2 - _ACCEL_MPS2) * value)


def action_for(acceleration: float, aside: float) -> tuple[float, float]:
    """The numbers with which `aim` comes closest to an acceleration (m/s2) and a place beside the route (m, left)."""
    second = math.copysign(min(math.sqrt(abs(aside) / _ASIDE_M), 1.0), aside)
    if acceleration >= 0.0:
        return min(acceleration / _ACCEL_MPS2, 1.0), second
    steeper = _BRAKE_MPS2 - _ACCEL_MPS2
    root = math.sqrt(_ACCEL_MPS2 * _ACCEL_MPS2 - 4.0 * steeper * acceleration)
    return max((_ACCEL_MPS2 - root) / (2.0 * steeper), -1.0), second


def aim(first: float, second: float, observation: Observation) -> Control:
    """Acceleration, and a lateral place to go to: 0 the route itself, 1 = 3.5 m to the left of it."""
    ego, route = observation.ego, observation.route
    second = min(max(second, -1.0), 1.0)
    wanted = _ASIDE_M * second * abs(second)
    close, far = max(_LEAST_AHEAD_M, _AHEAD_S * ego.speed), max(_LEAST_SWERVE_M, _SWERVE_S * ego.speed)
    # Near the line that it wants the ego keeps to it as tightly as `pursue_route`; else it looks farther ahead.
    away = abs(wanted - route.d)
    share = min(away / _ON_LINE_M, 1.0)
    ahead = close + share * (far - close)
    offset = route.d + min(max(wanted - route.d, -_SLOPE * ahead), _SLOPE * ahead)
    x, y = route.path.line.point_at(route.s + ahead, offset)
    return Control(accelerate(first), pursue(ego.x, ego.y, ego.heading, x, y))


def steer(first: float, second: float, observation: Observation) -> Control:  # noqa: ARG001
    """Acceleration, and the steering angle as a share of full lock, left positive."""
    return Control(accelerate(first), MAX_STEER_RAD * min(max(second, -1.0), 1.0))


ACTIONS: dict[str, Act] = {"aim": aim, "steer": steer}
