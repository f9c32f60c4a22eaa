"""`carl`'s network without torch: the same actions, in the same bits, on every CPU and in every batch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from tsbench.geometry.elementary import exp, log
from tsbench.geometry.polyline import Array
from tsbench.planners.carl.raster import MEASUREMENTS
from tsbench.planners.common.batching import Records
from tsbench.planners.common.convolution import LARGEST, Convolution, rectified
from tsbench.planners.common.fixed_point import BITS, Linear, snap
from tsbench.planners.common.parameters import Parameters

_FULL = 255
# Measurements are about -1..1; what is beyond is cut, which bounds all that follows.
_MOST = 8.0
_STRIDES = (4, 2, 2)


class CarlEngine:
    """(b,) records to (b, 2, 2) parameters of the Beta densities of both actions.

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
        self._wide, self._joint = (
            Linear(*of.linear(f"trunk.{name}.0"), bound=LARGEST) for name in ("wide", "joint")
        )
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
