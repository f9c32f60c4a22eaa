"""`carl`: the raster through a small CNN; its Beta densities are drawn from. Sign-blind."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from tsbench.geometry.elementary import Array
from tsbench.planners.base import Observation, PlannerContext
from tsbench.planners.carl.engine import CarlEngine
from tsbench.planners.carl.raster import CHANNELS, MEASUREMENTS, PIXELS, RasterEncoder
from tsbench.planners.common.batching import Infer, Records, check_device
from tsbench.planners.common.quantiles import beta_quantile
from tsbench.planners.rl.base import ACTIONS, DRAW, LearnedPlanner
from tsbench.planners.weights import Tensors, fitted

WEIGHTS = "carl"
RECORD = np.dtype(
    [("bev", np.uint8, (CHANNELS, PIXELS, PIXELS)), ("measurements", np.float32, (MEASUREMENTS,)), DRAW]
)


class Carl(LearnedPlanner):
    """The planner."""

    inputs: ClassVar[np.dtype[Any]] = RECORD
    served_on: ClassVar[tuple[str, ...]] = ("cuda",)

    def __init__(self, infer: Infer | None = None, folder: Path | None = None) -> None:
        super().__init__(infer, folder)
        self._encoder = RasterEncoder()

    @staticmethod
    def network(device: str, folder: Path | None = None) -> Infer:
        """The CNN: by the engine on a CPU, by torch on a GPU."""
        densities = fitted(
            WEIGHTS,
            folder,
            lambda weights: CarlEngine(weights) if device == "cpu" else _by_torch(weights, device),
        )

        def infer(records: Records) -> Records:
            answers = np.empty(len(records), dtype=ACTIONS)
            found, draws = densities(records).tolist(), records["draw"].tolist()
            answers["action"] = [
                [2.0 * beta_quantile(a, b, p) - 1.0 for a, b, p in zip(*pair, draw, strict=True)]
                for pair, draw in zip(found, draws, strict=True)
            ]
            return answers

        return infer

    def reset(self, context: PlannerContext) -> None:
        super().reset(context)
        self._encoder.reset(context)

    def fill(self, record: Records, observation: Observation) -> None:
        record["bev"][0], record["measurements"][0] = self._encoder.encode(observation)


def _by_torch(weights: Tensors, device: str) -> Callable[[Records], Array]:
    import torch

    check_device(device)
    from tsbench.planners.carl.network import CarlActor

    net = CarlActor()
    net.load_state_dict({key: torch.from_numpy(np.array(value)) for key, value in weights.items()})
    net = net.to(device).eval()

    def densities(records: Records) -> Array:
        found = []
        with torch.inference_mode():
            # One at a time: convolutions of several rows round differently.
            for k in range(len(records)):
                seen = (np.array(records[name][k : k + 1]) for name in ("bev", "measurements"))
                found.append(net(*(torch.from_numpy(x).to(device) for x in seen)).double().cpu().numpy())
        return np.concatenate(found)

    return densities
