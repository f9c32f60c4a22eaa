"""`carl`: the raster through a small CNN; the mode of its Beta densities is the action. Sign-blind.

Torch is imported when the planner is made, not before.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tsbench.errors import InputError
from tsbench.geometry.polyline import Array
from tsbench.planners.base import Observation, PlannerContext
from tsbench.planners.carl.raster import CHANNELS, MEASUREMENTS, PIXELS, RasterEncoder
from tsbench.planners.expert import Expert
from tsbench.planners.learned import Inputs, LearnedPlanner
from tsbench.planners.weights import load_weights

WEIGHTS = "carl"
RECORD = np.dtype(
    [("bev", np.uint8, (CHANNELS, PIXELS, PIXELS)), ("measurements", np.float32, (MEASUREMENTS,))]
)


class Carl(LearnedPlanner):
    """The planner."""

    def __init__(self, folder: Path | None = None, device: str = "cpu") -> None:
        """`folder`: of the weights, as `tsbench train carl --out` makes it; None for those that come with tsbench."""
        import torch

        from tsbench.planners.carl.network import CarlActor

        super().__init__()
        self._torch, self._device = torch, torch.device(device)
        net = CarlActor()
        tensors = {k: torch.from_numpy(np.array(v)) for k, v in load_weights(WEIGHTS, folder).items()}
        try:
            net.load_state_dict(tensors)
        except RuntimeError as error:
            problem = " ".join(str(error).split())[:200]
            raise InputError(f"weights {WEIGHTS!r}: are not those of carl's network ({problem})") from None
        self._net = net.to(self._device).eval()
        self._encoder = RasterEncoder()

    def reset(self, context: PlannerContext) -> None:
        """Start an episode."""
        super().reset(context)
        self._encoder.reset(context)

    def encode(self, observation: Observation) -> Inputs:
        """(1,) record: `bev` (9, 128, 128) uint8, `measurements` (10,) float32."""
        record = np.empty(1, dtype=RECORD)
        record["bev"][0], record["measurements"][0] = self._encoder.encode(observation)
        return record

    def infer(self, inputs: Inputs) -> Array:
        """(b, 2) modes; one row at a time, as convolutions of several rows round differently."""
        torch = self._torch
        out = np.empty((len(inputs), 2))
        with torch.inference_mode():
            for k in range(len(inputs)):
                bev = torch.from_numpy(inputs["bev"][k : k + 1]).to(self._device)
                measured = torch.from_numpy(inputs["measurements"][k : k + 1]).to(self._device)
                out[k] = self._net(bev, measured)[0].cpu().numpy()
        return out


class CarlExpert(Expert):
    """`carl-e`."""

    def __init__(self) -> None:
        super().__init__(Carl())
