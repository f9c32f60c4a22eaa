"""A turned rectangle cut out of a drawing, in whole numbers: the same bytes on every CPU.

OpenCV's own way interpolates by whatever instructions the CPU has, and answers differ in a pixel here and there.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tsbench.geometry.elementary import Array

Image = npt.NDArray[np.uint8]
# A pixel's channels, each in a lane of 16 bits, so that one product weighs them all.
Packed = npt.NDArray[np.uint64]

_LANE_BITS, _MOST_CHANNELS = 16, 4
# Places are known to a 256th of a pixel, and weights sum to 256.
_FINE_BITS = 8
_FINE = 1 << _FINE_BITS
# Half of 256 in each lane, for rounding.
_HALVES = np.uint64(sum(_FINE // 2 << _LANE_BITS * k for k in range(_MOST_CHANNELS)))
# Empty pixels around a drawing, where all that is outside ends up.
_FRAME = 2


def pack(channels: list[Image]) -> Packed:
    """Up to four (h, w) channels as one drawing, with an empty frame."""
    assert len(channels) <= _MOST_CHANNELS
    h, w = channels[0].shape
    packed: Packed = np.zeros((h + 2 * _FRAME, w + 2 * _FRAME), dtype=np.uint64)
    for k, channel in enumerate(channels):
        repack(packed, k, channel)
    return packed


def repack(packed: Packed, place: int, channel: Image) -> None:
    inner = packed[_FRAME:-_FRAME, _FRAME:-_FRAME]
    shift = np.uint64(_LANE_BITS * place)
    inner &= ~(np.uint64(0xFF) << shift)
    inner |= channel.astype(np.uint64) << shift


def cut(packed: Packed, matrix: Array, channels: int, rows: int, columns: int) -> Image:
    """(channels, rows, columns), interpolated between pixels; 0 outside. matrix: (2, 3), from a place in the rectangle
    (column, row, 1) to one in the drawing (x, y), where whole numbers are the middles of pixels.
    """
    across, down = np.arange(float(columns)), np.arange(float(rows))[:, None]
    places = [matrix[k, 0] * across + (matrix[k, 1] * down + matrix[k, 2]) for k in (0, 1)]
    x, y = (np.rint(place * _FINE).astype(np.int64) for place in places)
    u, v = (x & (_FINE - 1)).view(np.uint64), (y & (_FINE - 1)).view(np.uint64)
    h, w = packed.shape
    column = np.clip((x >> _FINE_BITS) + _FRAME, 0, w - 2)
    row = np.clip((y >> _FINE_BITS) + _FRAME, 0, h - 2)
    at = row * w + column
    pixels = packed.ravel()
    both = (u * v + np.uint64(_FINE // 2)) >> np.uint64(_FINE_BITS)
    total = pixels.take(at) * (np.uint64(_FINE) - u - v + both)
    total += pixels.take(at + 1) * (u - both)
    total += pixels.take(at + w) * (v - both)
    total += pixels.take(at + (w + 1)) * both
    total += _HALVES
    found: Image = np.empty((channels, rows, columns), dtype=np.uint8)
    for k in range(channels):
        found[k] = total >> np.uint64(_LANE_BITS * k + _FINE_BITS)
    return found
