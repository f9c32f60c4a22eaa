"""Networks in fixed-point numbers held by float64: the same bits on every CPU, in batches of any size.

What is multiplied is first rounded to a multiple of a power of two, so coarse that no sum of products needs more than
the 53 bits that a float64 has. Such sums are exact, in whatever order a BLAS adds them up. All else is one IEEE
operation at a time. The price of the rounding is about what float32 rounds too.

Convolutions are exact products of blocks with a matrix; pictures are (b, h, w, c). `Parameters` takes arrays out of
weights, for layers of all kinds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from copy import copy
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from tsbench.geometry import elementary
from tsbench.geometry.elementary import Array, exp, normal_density, normal_share

# Activations are multiples of 2**-BITS.
BITS = 21
# One bit less than float64 has, for what rounding adds.
SUM_BITS = 52
_FINEST, _COARSEST = 30, 12
# Outputs whose weights lie together: they are read from one end to the other while few rows stay at hand.
_TOGETHER = 32
# `Curve`: straight pieces of 2**-9 are off by at most 5e-7 times the second derivative, those of 2**-11 by 3e-8.
_PIECE_BITS, _FALLING_PIECE_BITS, _FALLING_BITS = 9, 11, 26
_FAINTEST, _FLAT = -24.0, 16
_LEAST_BITS = 6


def rounding_offset(bits: float | Array) -> float | Array:
    """Added to a number below 2**(51 - bits) and taken away again, it leaves the nearest multiple of 2**-bits."""
    found: float | Array = 1.5 * 2.0 ** (SUM_BITS - bits)
    return found


def snap(x: Array, bits: int = BITS) -> Array:
    """Round to multiples of 2**-bits, in place."""
    x += rounding_offset(bits)
    x -= rounding_offset(bits)
    return x


def tree_sum(x: Array) -> Array:
    """Sum over the last axis, whose length is a power of two, in an order of its own: (..., 1)."""
    while x.shape[-1] > 1:
        half = x.shape[-1] // 2
        x = x[..., :half] + x[..., half:]
    return x


def row_sums(x: Array) -> Array:
    """`tree_sum` of (n, width): for some ten rows in half the time."""
    turned = np.ascontiguousarray(x.T)
    while len(turned) > 1:
        half = len(turned) // 2
        turned = turned[:half] + turned[half:]
    return turned.T


class Linear:
    """Rows times a matrix, plus a bias.

    weight: (out, in). bound: most that an input is; norm: most that a row's Euclidean norm is. bits: inputs are
    multiples of 2**-bits. snapped: outputs are multiples of 2**-snapped, one number or one of each output; None: as
    they come. Raises ValueError for weights so large that exact sums would be too coarse.

    Attributes: lift: what is added and taken away again, so that outputs are rounded; bias: with
    the lift; bound: most that an output is.
    """

    def __init__(
        self,
        weight: npt.NDArray[np.floating],
        bias: npt.NDArray[np.floating],
        *,
        bound: float,
        norm: float = math.inf,
        bits: int = BITS,
        snapped: int | Array | None = BITS,
    ) -> None:
        w = np.array(weight, dtype=np.float64, order="C")
        if not (np.isfinite(w).all() and np.isfinite(bias).all()) or bias.shape != w.shape[:1]:
            raise ValueError("weights that are no finite numbers, or do not fit")
        sizes = largest(w, bound, norm)
        most = float(sizes.max())
        fine = min(SUM_BITS - bits - math.ceil(math.log2(max(most, 1.0))), _FINEST)
        if fine < _COARSEST:
            raise ValueError(f"weights too large for exact sums: up to {most:.3g}")
        self._blocks = _blocks(snap(w, fine))
        b = bias.astype(np.float64)
        self.bound = float((sizes + np.abs(b)).max())
        self.lift: float | Array = 0.0 if snapped is None else rounding_offset(snapped)
        self.bias: Array = b + self.lift
        self._snaps = snapped is not None

    @property
    def weight(self) -> Array:
        """(out, in), as rounded."""
        blocks, told, together = self._blocks.shape
        return self._blocks.transpose(0, 2, 1).reshape(blocks * together, told)

    def __call__(self, x: Array) -> Array:
        """(..., in) to (..., out)."""
        blocks, told, together = self._blocks.shape
        rows = x.reshape(-1, told)
        parts = np.empty((len(rows), blocks, together))
        np.matmul(rows, self._blocks, out=parts.transpose(1, 0, 2))
        y: Array = parts.reshape(*x.shape[:-1], blocks * together)
        y += self.bias
        if self._snaps:
            y -= self.lift
        return y

    def part(self, outputs: slice) -> Linear:
        """Some of the outputs alone, with the numbers that they have among all."""
        found = copy(self)
        found._blocks, found.bias = _blocks(self.weight[outputs]), self.bias[outputs]
        if isinstance(self.lift, np.ndarray):
            found.lift = self.lift[outputs]
        return found


def _blocks(weight: Array) -> Array:
    """(out, in) as (blocks, in, outputs of a block)."""
    out, told = weight.shape
    together = out if out % _TOGETHER else _TOGETHER
    return np.ascontiguousarray(weight.reshape(-1, together, told).transpose(0, 2, 1))


def largest(weight: Array, bound: float, norm: float = math.inf) -> Array:
    """(out,) most that any part of each output's sum can be."""
    sizes: Array = np.abs(weight).sum(axis=1) * bound
    if norm < math.inf:
        np.minimum(sizes, np.sqrt(np.square(weight).sum(axis=1)) * norm, out=sizes)
    return sizes


class Curve:
    """A function of one number by straight pieces of 2**-piece_bits between low and high; its values are multiples of
    2**-bits.
    """

    def __init__(
        self,
        values: Callable[[Array], Array],
        slopes: Callable[[Array], Array],
        low: int,
        high: int,
        piece_bits: int = _PIECE_BITS,
        bits: int = BITS,
    ) -> None:
        at = np.arange(low << piece_bits, (high << piece_bits) + 1) / (1 << piece_bits)
        self._lift = float(rounding_offset(bits))
        # With what rounds to the grid added already.
        self._values, self._slopes = values(at) + self._lift, slopes(at)
        self._to_piece = float(rounding_offset(piece_bits))
        self._first = int(np.float64(self._to_piece + low).view(np.int64))

    def __call__(self, x: Array) -> Array:
        """In place; x is contiguous."""
        nearest = x + self._to_piece
        # So shifted, neighbouring pieces are neighbouring floats.
        piece = nearest.view(np.int64) - self._first
        nearest -= self._to_piece
        x -= nearest
        x *= self._slopes.take(piece, mode="clip", out=nearest)
        x += self._values.take(piece, mode="clip", out=nearest)
        x -= self._lift
        return x


def gelu(most: float) -> Curve:
    """The Gaussian error linear unit between -most and most."""
    # Layers of about the same reach share a table, which then stays in the CPU's cache.
    return _gelu(1 << max(math.ceil(math.log2(most)), _LEAST_BITS))


@cache
def _gelu(reach: int) -> Curve:
    return Curve(lambda x: x * normal_share(x), lambda x: normal_share(x) + x * normal_density(x), -reach, reach)


@cache
def _falling() -> Curve:
    return Curve(exp, exp, int(_FAINTEST), 0, _FALLING_PIECE_BITS, _FALLING_BITS)


@cache
def _bent() -> Curve:
    def slopes(x: Array) -> Array:
        height = elementary.tanh(x)
        return 1.0 - height * height

    return Curve(elementary.tanh, slopes, -_FLAT, _FLAT)


def tanh(x: Array) -> Array:
    """As multiples of 2**-BITS; x, contiguous, is overwritten."""
    return _bent()(np.clip(x, -_FLAT, _FLAT, out=x))


def softmax(x: Array, bits: int) -> Array:
    """Over the first axis, as multiples of 2**-bits; x, contiguous, is overwritten."""
    x -= np.maximum.reduce(x, axis=0)
    np.maximum(x, _FAINTEST, out=x)
    share = _falling()(x)
    share /= np.add.reduce(share, axis=0)
    return snap(share, bits)


class LayerNorm:
    """Of rows whose length is a power of two; answers are multiples of 2**-BITS.

    Attributes: norm: most that an answer's Euclidean norm is.
    """

    def __init__(self, weight: npt.NDArray[np.floating], bias: npt.NDArray[np.floating], epsilon: float = 1e-5) -> None:
        self._width = len(weight)
        if self._width & (self._width - 1) or bias.shape != weight.shape:
            raise ValueError("a layer's width is no power of two, or does not fit")
        self._weight, self._lift, self._epsilon = weight.astype(np.float64), float(rounding_offset(BITS)), epsilon
        self._bias = bias.astype(np.float64) + self._lift
        self.norm = 1.001 * float(
            math.sqrt(self._width) * np.abs(weight).max() + math.sqrt(np.square(bias.astype(np.float64)).sum())
        )

    def __call__(self, x: Array) -> Array:
        """(n, width), in place."""
        x -= row_sums(x) / self._width
        x *= 1.0 / np.sqrt(row_sums(x * x) / self._width + self._epsilon)
        x *= self._weight
        x += self._bias
        x -= self._lift
        return x


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
