"""`carl`: the raster through a small CNN; its Beta densities are drawn from. Sign-blind."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from tsbench.geometry.elementary import exp, log
from tsbench.geometry.polyline import Array
from tsbench.learn.carl.raster import CHANNELS, MEASUREMENTS, PIXELS, RasterEncoder
from tsbench.learn.networks.fixed_point import BITS, LARGEST, Convolution, Linear, Parameters, rectified, snap
from tsbench.learn.rl.actions import DRAW, TWO_ACTIONS, LearnedPlanner, beta_quantile
from tsbench.planners.base import Observation, PlannerContext
from tsbench.planners.batching import Infer, Records
from tsbench.planners.weights import fitted

_FULL = 255
# Measurements are about -1..1; what is beyond is cut, which bounds all that follows.
_MOST = 8.0
_STRIDES = (4, 2, 2)


class CarlEngine:
    """(b,) records to (b, 2, 2) parameters of the Beta densities of both actions: without torch, the same actions in
    the same bits, on every CPU and in every batch.

    Raises KeyError or ValueError for weights that are not those of the network.
    """

    def __init__(self, weights: Mapping[str, npt.NDArray[Any]]) -> None:
        of = Parameters(weights)
        self._convolutions: list[Convolution] = []
        # Pixels are whole numbers: the first weights may be so much finer.
        bound, bits, scale = float(_FULL), 0, float(_FULL)
        for k, stride in enumerate(_STRIDES):
            weight, bias = of.linear(f"trunk.image.{2 * k}")
            self._convolutions.append(Convolution(weight / scale, bias, stride, bound=bound, bits=bits))
            bound, bits, scale = LARGEST, BITS, 1.0
        self._wide, self._joint = (Linear(*of.linear(f"trunk.{name}.0"), bound=LARGEST) for name in ("wide", "joint"))
        self._measured = Linear(*of.linear("trunk.measured.0"), bound=_MOST)
        self._action = Linear(*of.linear("action"), bound=LARGEST, snapped=None)
        of.end()
        if self._measured.weight.shape[1] != MEASUREMENTS:
            raise ValueError(f"{self._measured.weight.shape[1]} measurements")

    def __call__(self, records: Records) -> Array:
        x: Any = records["bev"].transpose(0, 2, 3, 1)
        for convolution in self._convolutions:
            x = rectified(convolution(x))
        seen = rectified(self._wide(x.transpose(0, 3, 1, 2).reshape(len(x), -1)))
        told = snap(np.clip(records["measurements"].astype(np.float64), -_MOST, _MOST))
        latent = rectified(self._joint(np.concatenate([seen, rectified(self._measured(told))], axis=1)))
        raw = self._action(latent)
        # 1 + softplus: each parameter is above 1.
        return (1.0 + np.maximum(raw, 0.0) + log(1.0 + exp(-np.abs(raw)))).reshape(-1, 2, 2)


WEIGHTS = "carl"
RECORD = np.dtype([("bev", np.uint8, (CHANNELS, PIXELS, PIXELS)), ("measurements", np.float32, (MEASUREMENTS,)), DRAW])


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
        densities: Callable[[Records], Array]
        if device == "cpu":
            densities = fitted(WEIGHTS, folder, CarlEngine)
        else:
            from tsbench.learn.carl.carl_network import densities_by_torch

            densities = fitted(WEIGHTS, folder, lambda weights: densities_by_torch(weights, device))

        def infer(records: Records) -> Records:
            answers = np.empty(len(records), dtype=TWO_ACTIONS)
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
