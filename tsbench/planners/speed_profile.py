"""A path made ready for driving, once per path: a point every metre, and the speed that it allows there.

Units: m, m/s, rad.
"""

from __future__ import annotations

import math

import numpy as np

from tsbench.geometry.elementary import arctan2
from tsbench.geometry.polyline import Array
from tsbench.roads.lane_graph import RoutePath

# Bends are measured over this length: netconvert draws a turn as a few chords, whose corners are no bends.
_BEND_WINDOW_M = 6
_SLOWEST_MPS = 1.5


class PathSamples:
    """Points of a path every metre, from its start.

    Attributes
    ----------
    x, y : m; cos, sin : direction of travel (plain lists, for scalar look-ups).
    curvature : (n,) 1/m, unsigned.
    last : index of the last sample.
    """

    __slots__ = ("cos", "curvature", "last", "sin", "x", "y")

    def __init__(self, path: RoutePath) -> None:
        line = path.line
        n = max(int(line.length), 2) + 1
        at = np.arange(n, dtype=np.float64)
        x, y = np.interp(at, line.s, line.points[:, 0]), np.interp(at, line.s, line.points[:, 1])
        dx, dy = np.diff(x), np.diff(y)
        heading = np.unwrap(arctan2(dy, dx))
        self.curvature: Array = _curvature(heading, n)
        norm = np.maximum(np.hypot(dx, dy), 1e-9)
        self.x: list[float] = x.tolist()
        self.y: list[float] = y.tolist()
        self.cos: list[float] = (dx / norm).tolist()
        self.sin: list[float] = (dy / norm).tolist()
        self.cos.append(self.cos[-1])
        self.sin.append(self.sin[-1])
        self.last = n - 1


def _curvature(heading: Array, n: int) -> Array:
    half = _BEND_WINDOW_M // 2
    padded = np.concatenate((np.full(half, heading[0]), heading, np.full(half + 1, heading[-1])))
    bend: Array = np.abs(padded[2 * half : 2 * half + n] - padded[:n]) / (2 * half)
    return bend


def speed_profile(
    path: RoutePath, samples: PathSamples, *, lateral: float, decel: float, factor: float, top: float
) -> list[float]:
    """Greatest speed at each sample: bends at `lateral` m/s2, `factor` x the limit, at most `top`.

    Slower stretches are reached by braking at `decel` m/s2, which a backward pass over the path provides for.
    """
    at = np.arange(samples.last + 1, dtype=np.float64)
    where = np.maximum(np.searchsorted(path.limit_s, at + 1e-9, side="right") - 1, 0)
    bend = np.sqrt(lateral / np.maximum(samples.curvature, 1e-4))
    cap = np.maximum(np.minimum(np.minimum(bend, path.limit[where] * factor), top), _SLOWEST_MPS)
    speeds: list[float] = cap.tolist()
    for i in range(len(speeds) - 2, -1, -1):
        reachable = math.sqrt(speeds[i + 1] ** 2 + 2.0 * decel)
        speeds[i] = min(speeds[i], reachable)
    return speeds


def speed_at(speeds: list[float], s: float) -> float:
    """The profile at arc length s, between samples linearly."""
    i = int(s) if s > 0.0 else 0
    if i >= len(speeds) - 1:
        return speeds[-1]
    return speeds[i] + (s - i) * (speeds[i + 1] - speeds[i]) if s > 0.0 else speeds[0]
