"""What an environment shows: the kinds of observation, each with its space and its encoder."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

import numpy as np
from gymnasium import spaces

from tsbench.envs.objects import ObjectsSeen
from tsbench.envs.scene import SceneSeen
from tsbench.planners.base import Observation, PlannerContext
from tsbench.planners.ppo.vector import SIZE, VectorEncoder


class ObservationEncoder(Protocol):
    """One kind of observation; `encode` gives elements of `space`."""

    space: spaces.Space[Any]

    def reset(self, context: PlannerContext) -> None: ...

    def encode(self, observation: Observation) -> Any: ...


class VectorSeen(VectorEncoder):
    """`vector`: the 275 numbers of `ppo`."""

    space: spaces.Space[Any] = spaces.Box(-2.0, 2.0, (SIZE,), np.float32)


def _bev() -> ObservationEncoder:
    # OpenCV is needed by none of the others.
    from tsbench.planners.carl.raster import CHANNELS, MEASUREMENTS, PIXELS, RasterEncoder

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

    return BevSeen()


KINDS: dict[str, Callable[[], ObservationEncoder]] = {
    "vector": VectorSeen, "bev": _bev, "objects": ObjectsSeen, "scene": SceneSeen,
    "plates": partial(SceneSeen, lanes=False),
}  # fmt: skip
