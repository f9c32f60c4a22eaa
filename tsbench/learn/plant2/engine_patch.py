"""Encoders of the bird's-eye patch for the engine: as their torch counterparts, one token each."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tsbench.geometry.polyline import Array
from tsbench.learn.networks.convolution import LARGEST, Convolution, Parameters, rectified
from tsbench.learn.networks.fixed_point import Linear, gelu
from tsbench.learn.plant2 import layout as at
from tsbench.learn.plant2.layout import TILE

_FULL = 255


class TiledPatchEngine:
    """Each tile on its own, then all together."""

    def __init__(self, of: Parameters) -> None:
        weight, bias = of.linear("patch.each")
        # Pixels are whole numbers: the weights may be so much finer.
        self._each = Linear(weight / np.float64(_FULL), bias, bound=_FULL, bits=0, snapped=None)
        self._bend = gelu(self._each.bound)
        self._out = Linear(*of.linear("patch.out"), bound=self._each.bound, snapped=None)

    def __call__(self, patch: npt.NDArray[np.uint8]) -> Array:
        b, down, across = len(patch), at.PATCH_ROWS // TILE, at.PATCH_COLUMNS // TILE
        # Pixels are moved by eights, which is as many as a tile is wide.
        eights = patch.view(np.uint64).reshape(b, at.PATCH_CHANNELS, down, TILE, across)
        tiles = np.ascontiguousarray(eights.transpose(0, 2, 4, 1, 3)).view(np.uint8)
        rows = tiles.reshape(b * down * across, -1).astype(np.float64)
        return self._out(self._bend(self._each(rows)).reshape(b, -1))


class _Residual:
    """Two convolutions and a way around them."""

    def __init__(self, of: Parameters, name: str, stride: int, area: int) -> None:
        self._first, self._second = (
            _convolution(of, f"{name}.first", stride, 1),
            _convolution(of, f"{name}.second", 1, 1),
        )
        self._first_norm, self._second_norm = (of.group_norm(f"{name}.{k}_norm", area) for k in ("first", "second"))
        self._around = _convolution(of, f"{name}.around", stride, 0) if stride > 1 else None

    def __call__(self, x: Array) -> Array:
        inner = rectified(self._first_norm(self._first(x)))
        return rectified(self._second_norm(self._second(inner)) + (self._around(x) if self._around else x))


class ResidualPatchEngine:
    """A ResNet-18 of so many stages, normalised per sample."""

    def __init__(self, of: Parameters, stages: int) -> None:
        weight = of.take("patch.trunk.0.weight") / np.float64(_FULL)
        area = at.PATCH_ROWS * at.PATCH_COLUMNS // 4
        self._first = Convolution(weight, np.zeros(len(weight)), 2, 3, bound=_FULL, bits=0)
        self._norm = of.group_norm("patch.trunk.1", area)
        self._blocks: list[_Residual] = []
        for k in range(2 * stages):
            stride = 2 - k % 2
            area //= stride * stride
            # Before them stand a convolution, its normalisation and a rectifier.
            self._blocks.append(_Residual(of, f"patch.trunk.{3 + k}", stride, area))
        self._out = Linear(*of.linear("patch.out"), bound=LARGEST, snapped=None)

    def __call__(self, patch: npt.NDArray[np.uint8]) -> Array:
        x = rectified(self._norm(self._first(patch.transpose(0, 2, 3, 1).astype(np.float64))))
        for block in self._blocks:
            x = block(x)
        return self._out(x.transpose(0, 3, 1, 2).reshape(len(x), -1))


def _convolution(of: Parameters, name: str, stride: int, pad: int) -> Convolution:
    weight = of.take(f"{name}.weight")
    return Convolution(weight, np.zeros(len(weight)), stride, pad, bound=LARGEST)
