"""The ego in a few numbers of about -1..1, for planners that learn. Blind to signs: limits are the road's own.

`cut` takes a turned rectangle out of a drawing, in whole numbers: the same bytes on every CPU. OpenCV's own way
interpolates by whatever instructions the CPU has, and answers differ in a pixel here and there. Units: m, m/s.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np
import numpy.typing as npt

from tsbench.geometry.elementary import Array, wrap
from tsbench.planners.geometry import PathSamples, speed_at, speed_profile
from tsbench.planners.observation import Observation
from tsbench.roads.lane_graph import RoutePath
from tsbench.sim.ego import MAX_DECEL_MPS2, MAX_SPEED_MPS, MAX_STEER_RAD
from tsbench.sim.navigation import RouteView

K = TypeVar("K")
V = TypeVar("V")

# Of `carl`'s raster, and the numbers beside it.
CHANNELS, PIXELS, MEASUREMENTS = 9, 128, 10
_MOST = 4


class Recent(Generic[K, V]):
    """Makes a value of a thing when it is first asked for, and keeps those of the last four. Things go by identity."""

    def __init__(self, make: Callable[[K], V]) -> None:
        self._make = make
        self._kept: list[tuple[K, V]] = []

    def __call__(self, thing: K) -> V:
        for known, value in self._kept:
            if known is thing:
                return value
        value = self._make(thing)
        self._kept = [(thing, value), *self._kept[: _MOST - 1]]
        return value


_LATERAL_MPS2, _DECEL_MPS2 = 2.2, 2.0
_PREVIEW_S = 0.5


class RouteSpeed:
    """Prepared once per path: a few are kept, as an expert's constraint and the navigation may take turns."""

    def __init__(self) -> None:
        self._of: Recent[RoutePath, tuple[list[float], list[float]]] = Recent(_limits_and_speeds)

    def limit(self, route: RouteView) -> float:
        limits = self._of(route.path)[0]
        return limits[min(max(int(route.s), 0), len(limits) - 1)]

    def allowed(self, route: RouteView, speed: float) -> float:
        """Greatest speed half a second ahead at `speed`: limit, bends, and braking for what comes."""
        return speed_at(self._of(route.path)[1], route.s + _PREVIEW_S * speed)


def _limits_and_speeds(path: RoutePath) -> tuple[list[float], list[float]]:
    """The limit between each metre and the next, and the speed profile."""
    samples = PathSamples(path)
    speeds = speed_profile(path, samples, lateral=_LATERAL_MPS2, decel=_DECEL_MPS2, factor=1.0, top=math.inf)
    middle = np.arange(samples.last + 1) + 0.5
    piece = np.maximum(np.searchsorted(path.limit_s, middle, side="right") - 1, 0)
    return path.limit[piece].tolist(), speeds


_OFFSET_M, _WAY_M = 5.0, 100.0
_SOON_M = 2.0


def clip(value: float) -> float:
    return min(max(value, -1.0), 1.0)


def motion(o: Observation) -> tuple[float, float, float, float]:
    """Speed, acceleration, steering, yaw rate."""
    ego = o.ego
    return (
        ego.speed / MAX_SPEED_MPS,
        max(ego.acceleration, -MAX_DECEL_MPS2) / MAX_DECEL_MPS2,
        ego.steering / MAX_STEER_RAD,
        clip(ego.yaw_rate),
    )


def on_route(o: Observation) -> tuple[float, float]:
    """Offset from the route (over 5 m) and heading against it (rad), left positive."""
    route = o.route
    off = wrap(o.ego.heading - route.path.line.heading_at(route.s + _SOON_M))
    return clip(route.d / _OFFSET_M), clip(off)


def ahead(o: Observation, distance: float) -> tuple[float, float]:
    """The route's point so many metres on, forward and left of the ego, over that distance."""
    ego, line = o.ego, o.route.path.line
    px, py = line.point_at(min(o.route.s + distance, line.length))
    dx, dy = px - ego.x, py - ego.y
    c, s = math.cos(ego.heading), math.sin(ego.heading)
    return clip((c * dx + s * dy) / distance), clip((c * dy - s * dx) / distance)


def pace(o: Observation, speed: RouteSpeed) -> tuple[float, float, float]:
    """Speed that bends and limit allow; the limit; the way to go (over 100 m)."""
    return (
        speed.allowed(o.route, o.ego.speed) / MAX_SPEED_MPS,
        speed.limit(o.route) / MAX_SPEED_MPS,
        min(o.route.remaining / _WAY_M, 1.0),
    )


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
    column = np.minimum(np.maximum((x >> _FINE_BITS) + _FRAME, 0), w - 2)
    row = np.minimum(np.maximum((y >> _FINE_BITS) + _FRAME, 0), h - 2)
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
