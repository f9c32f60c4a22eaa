"""`bev`: the raster and the measurements of `carl`."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from tsbench.planners.base import Observation
from tsbench.planners.carl.raster import CHANNELS, MEASUREMENTS, PIXELS, RasterEncoder


class BevSeen(RasterEncoder):
    """A dictionary of both."""

    def __init__(self) -> None:
        super().__init__()
        self.space: spaces.Space[Any] = spaces.Dict(
            {
                "bev": spaces.Box(0, 255, (CHANNELS, PIXELS, PIXELS), np.uint8),
                "measurements": spaces.Box(-2.0, 2.0, (MEASUREMENTS,), np.float32),
            }
        )

    def encode(self, observation: Observation) -> Any:
        """bev (9, 128, 128) uint8, measurements (10,) float32."""
        raster, measured = super().encode(observation)
        return {"bev": raster, "measurements": measured}
