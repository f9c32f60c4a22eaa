"""Convolutions in fixed-point numbers: products of windows, made contiguous, with a matrix. Pictures are (b, h, w, c)."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from tsbench.planners.fixed_point import BITS, Array, Linear, magic, tree_sum


class Convolution:
    """weight: (out, in, k, k). pad: zeros around. bound, bits, snapped: as of `Linear`. Attributes: bound: of outputs."""

    def __init__(
        self,
        weight: npt.NDArray[np.floating],
        bias: npt.NDArray[np.floating],
        stride: int,
        pad: int = 0,
        *,
        bound: float,
        bits: int = BITS,
        snapped: int | None = BITS,
    ) -> None:
        self._size, self._stride, self._pad = weight.shape[-1], stride, pad
        flat = weight.reshape(len(weight), -1)
        self._linear = Linear(flat, bias, bound=bound, bits=bits, snapped=snapped)
        self.bound = self._linear.bound

    def __call__(self, x: Array) -> Array:
        """(b, h, w, in) to (b, h', w', out)."""
        if self._pad:
            x = np.pad(x, ((0, 0), (self._pad, self._pad), (self._pad, self._pad), (0, 0)))
        windows = sliding_window_view(x, (self._size, self._size), axis=(1, 2))
        windows = windows[:, :: self._stride, :: self._stride]
        rows = np.ascontiguousarray(windows, dtype=np.float64)
        return self._linear(rows.reshape(*rows.shape[:3], -1))


class GroupNorm:
    """Normalises eight groups of channels of each picture, whose sizes are powers of two. Attributes: bound: of outputs."""

    groups = 8

    def __init__(self, weight: npt.NDArray[np.floating], bias: npt.NDArray[np.floating], area: int) -> None:
        self._count = area * len(weight) // self.groups
        if self._count & (self._count - 1):
            raise ValueError("a group's size is no power of two")
        self._weight, self._lift = weight.astype(np.float64), float(magic(BITS))
        self._bias = bias.astype(np.float64) + self._lift
        self.bound = 1.001 * float(math.sqrt(self._count) * np.abs(weight).max() + np.abs(bias).max())

    def __call__(self, x: Array) -> Array:
        """(b, h, w, c)."""
        b, h, w, c = x.shape
        grouped = np.ascontiguousarray(x.reshape(b, h * w, self.groups, -1).transpose(0, 2, 1, 3))
        grouped = grouped.reshape(b, self.groups, -1)
        grouped -= tree_sum(grouped) / self._count
        grouped *= 1.0 / np.sqrt(tree_sum(grouped * grouped) / self._count + 1e-5)
        y = grouped.reshape(b, self.groups, h * w, -1).transpose(0, 2, 1, 3).reshape(b, h, w, c)
        y = y * self._weight
        y += self._bias
        y -= self._lift
        return y
