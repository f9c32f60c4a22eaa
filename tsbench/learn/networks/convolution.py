"""Convolutions in fixed-point numbers: exact products of blocks with a matrix. Pictures are (b, h, w, c).

`Parameters` takes arrays out of weights, for layers of both kinds.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from tsbench.geometry.polyline import Array
from tsbench.learn.networks.fixed_point import BITS, LayerNorm, Linear, rounding_offset, tree_sum

# Measured activations are below 20.
LARGEST = 64.0


class Convolution:
    """weight: (out, in, k, k). pad: zeros around. bound, bits: as of `Linear`.

    The picture is cut into blocks as long as a stride, and each block multiplied once with all parts of the weight that
    ever meet it: windows overlap, blocks do not.
    """

    def __init__(
        self,
        weight: npt.NDArray[np.floating],
        bias: npt.NDArray[np.floating],
        stride: int,
        pad: int = 0,
        *,
        bound: float,
        bits: int = BITS,
    ) -> None:
        out, channels, size, _ = weight.shape
        self._size, self._stride, self._pad = size, stride, pad
        self._parts = -(-size // stride)
        more = self._parts * stride - size
        whole = Linear(weight.reshape(out, -1), bias, bound=bound, bits=bits)
        # (part down, part across, out) rows of (in, pixel down, pixel across) within a block.
        blocks = np.pad(whole.weight.reshape(weight.shape), ((0, 0), (0, 0), (0, more), (0, more)))
        blocks = blocks.reshape(out, channels, self._parts, stride, self._parts, stride)
        self._weight: Array = blocks.transpose(2, 4, 0, 3, 5, 1).reshape(self._parts**2 * out, -1).copy()
        self._bias, self._lift, self._out = whole.bias, whole.lift, out

    def __call__(self, x: Array) -> Array:
        """(b, h, w, in) to (b, h', w', out)."""
        b, h, w, channels = x.shape
        stride, pad, parts = self._stride, self._pad, self._parts
        high, wide = ((side + 2 * pad - self._size) // stride + 1 for side in (h, w))
        # What no window reaches is left out, what only zeros of the weight meet is filled up.
        down, across = high + parts - 1, wide + parts - 1
        framed = np.zeros((b, down * stride, across * stride, channels))
        inner = framed[:, pad : pad + h, pad : pad + w]
        inner[...] = x[:, : inner.shape[1], : inner.shape[2]]
        blocks = framed.reshape(b, down, stride, across, stride, channels).transpose(0, 1, 3, 2, 4, 5)
        met = blocks.reshape(b * down * across, -1) @ self._weight.T
        met = met.reshape(b, down, across, parts, parts, self._out)
        y: Array = np.zeros((b, high, wide, self._out))
        for i in range(parts):
            for j in range(parts):
                y += met[:, i : i + high, j : j + wide, i, j]
        y += self._bias
        y -= self._lift
        return y


def rectified(x: Array) -> Array:
    """What is above 0, cut at LARGEST, in place: the bound of all that follows."""
    return np.clip(x, 0.0, LARGEST, out=x)


class GroupNorm:
    """Normalises eight groups of channels of each picture, whose sizes are powers of two."""

    groups = 8

    def __init__(self, weight: npt.NDArray[np.floating], bias: npt.NDArray[np.floating], area: int) -> None:
        self._count = area * len(weight) // self.groups
        if self._count & (self._count - 1):
            raise ValueError("a group's size is no power of two")
        self._weight, self._lift = weight.astype(np.float64), float(rounding_offset(BITS))
        self._bias = bias.astype(np.float64) + self._lift

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


Tensor = npt.NDArray[Any]


class Parameters:
    """Raises KeyError for a name that is not there."""

    def __init__(self, weights: Mapping[str, Tensor]) -> None:
        self._left = dict(weights)

    def take(self, name: str) -> Tensor:
        return self._left.pop(name)

    def linear(self, name: str) -> tuple[Tensor, Tensor]:
        return self.take(f"{name}.weight"), self.take(f"{name}.bias")

    def norm(self, name: str) -> LayerNorm:
        return LayerNorm(*self.linear(name))

    def group_norm(self, name: str, area: int) -> GroupNorm:
        """A normalisation of pictures of so many pixels."""
        return GroupNorm(*self.linear(name), area)

    def end(self, unused: tuple[str, ...] = ()) -> None:
        """Raises ValueError where something is left but the parts that are not used here."""
        left = sorted(name for name in self._left if name.partition(".")[0] not in unused)
        if left:
            raise ValueError(f"unexpected {', '.join(left)}")
