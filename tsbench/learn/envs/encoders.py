"""What an environment shows, each kind of observation with its space, and its actions of two numbers.

Units: m, m/s, m/s2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, Protocol

import numpy as np
from gymnasium import spaces

from tsbench.learn.carl.raster import CHANNELS, MEASUREMENTS, PIXELS, RasterEncoder
from tsbench.learn.envs.objects import ObjectsSeen
from tsbench.learn.envs.scene_seen import SceneSeen
from tsbench.learn.ppo.vector import SIZE, VectorEncoder
from tsbench.learn.rl.actions import ACTIONS, Act, accelerate, aim
from tsbench.planners.base import Control, Observation, PlannerContext


class ObservationEncoder(Protocol):
    """One kind of observation; `encode` gives elements of `space`."""

    space: spaces.Space[Any]

    def reset(self, context: PlannerContext) -> None: ...

    def encode(self, observation: Observation) -> Any: ...


class VectorSeen(VectorEncoder):
    """`vector`: the 275 numbers of `ppo`."""

    space: spaces.Space[Any] = spaces.Box(-2.0, 2.0, (SIZE,), np.float32)


class BevSeen(RasterEncoder):
    """The raster and the measurements of `carl`."""

    space: spaces.Space[Any] = spaces.Dict(
        {
            "bev": spaces.Box(0, 255, (CHANNELS, PIXELS, PIXELS), np.uint8),
            "measurements": spaces.Box(-2.0, 2.0, (MEASUREMENTS,), np.float32),
        }
    )

    def encode(self, observation: Observation) -> Any:
        raster, measured = super().encode(observation)
        return {"bev": raster, "measurements": measured}


KINDS: dict[str, Callable[[], ObservationEncoder]] = {
    "vector": VectorSeen,
    "bev": BevSeen,
    "objects": ObjectsSeen,
    "scene": SceneSeen,
    "plates": partial(SceneSeen, lanes=False),
}


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
