"""The environment's actions of two numbers. Units: m, m/s, m/s2."""

from __future__ import annotations

from dataclasses import replace

from tsbench.planners.base import Control, Observation
from tsbench.planners.rl.actions import ACTIONS, Act, accelerate, aim

_FASTEST_MPS, _GAIN_PER_S = 25.0, 1.0


def cruise(first: float, second: float, observation: Observation) -> Control:
    """A speed to drive at, -1 = 0 and 1 = 25 m/s, and a place beside the route as `aim` has it.

    A number that does not change keeps a limit; with `aim` that needs ever new ones.
    """
    wanted = _FASTEST_MPS * (min(max(first, -1.0), 1.0) + 1.0) / 2.0
    wish = _GAIN_PER_S * (wanted - observation.ego.speed)
    command = min(max(wish, accelerate(-1.0)), accelerate(1.0))
    return replace(aim(0.0, second, observation), acceleration=command)


PLAIN: dict[str, Act] = {**ACTIONS, "cruise": cruise}
