"""Fifteen ways on: five wished speeds by three offsets, each driven by the Intelligent Driver Model. Units: m, s."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tsbench.bridges.pdm.centerline import Centerline
from tsbench.geometry.elementary import arctan2
from tsbench.geometry.polyline import Array

STEP_S, STEPS = 0.2, 20
SHARES = (0.2, 0.4, 0.6, 0.8, 1.0)
OFFSETS_M = (-1.0, 0.0, 1.0)
# PDM-Closed's driver.
_HEADWAY_S, _GAP_M, _ACCEL_MPS2, _BRAKE_MPS2 = 1.5, 1.0, 1.5, 3.0
_HARDEST_MPS2 = 6.0
_LEAST_MPS = 0.5


@dataclass(frozen=True)
class Others:
    """What is around, forecast at constant velocity: (n, STEPS + 5) centres on a grid of STEP_S, four steps longer.

    x, y: world; s, d: on the centreline. (n,): along: speed along it; cos, sin: of the heading; length, width; still:
    a fixed thing.
    """

    x: Array
    y: Array
    s: Array
    d: Array
    along: Array
    cos: Array
    sin: Array
    length: Array
    width: Array
    still: npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Proposals:
    """(15, STEPS + 1) from now on: place on the centreline, speed, world pose."""

    s: Array
    d: Array
    speed: Array
    x: Array
    y: Array
    heading: Array


def roll_out(
    line: Centerline, s0: float, d0: float, speed: float, others: Others, length: float, width: float
) -> Proposals:
    """Drive all proposals along the centreline, each behind the leader that it has at that time.

    PDM-Closed simulates a car that tracks a proposal, and so learns who leaves a bend. Here the pose is the proposal's
    itself, and `Centerline.limit` bounds speeds in bends instead.
    """
    share = np.repeat(np.array(SHARES), len(OFFSETS_M))
    offset = np.tile(np.array(OFFSETS_M), len(SHARES))
    # The way over: it begins at a slope of a tenth or less and ends at none.
    over = np.maximum(np.maximum(10.0, 1.5 * speed), 20.0 * np.abs(offset - d0))
    s, v = np.full(len(share), s0), np.full(len(share), speed)
    rows_s, rows_v, rows_d = [s], [v], [np.full(len(share), d0)]
    for k in range(STEPS):
        d = _beside(s - s0, offset, d0, over)
        gap, lead = _leader(s, d, others, k, length, width)
        gap = np.maximum(np.minimum(gap, line.end + 100.0 - s), 0.1)
        top = np.maximum(share * line.limit[line.segment(s + 0.5 * v)], _LEAST_MPS)
        wish = _GAP_M + np.maximum(v * _HEADWAY_S + v * (v - lead) / (2.0 * np.sqrt(_ACCEL_MPS2 * _BRAKE_MPS2)), 0.0)
        free = (v / top) * (v / top)
        free = free * free * free * free * free
        pull = _ACCEL_MPS2 * (1.0 - free - (wish / gap) * (wish / gap))
        least = np.where(wish > gap, -_HARDEST_MPS2, -_BRAKE_MPS2)
        after = np.maximum(v + STEP_S * np.maximum(pull, least), 0.0)
        s = s + 0.5 * STEP_S * (v + after)
        v = after
        rows_s.append(s)
        rows_v.append(v)
        rows_d.append(_beside(s - s0, offset, d0, over))
    return posed(line, np.stack(rows_s, 1), np.stack(rows_d, 1), np.stack(rows_v, 1))


def stop(line: Centerline, s0: float, d0: float, speed: float) -> Proposals:
    """The one that brakes as hard as it may, in its place beside the line."""
    at = np.minimum(STEP_S * np.arange(STEPS + 1), speed / _HARDEST_MPS2)[None]
    s = s0 + speed * at - 0.5 * _HARDEST_MPS2 * at * at
    return posed(line, s, np.full(s.shape, d0), speed - _HARDEST_MPS2 * at)


def posed(line: Centerline, s: Array, d: Array, speed: Array) -> Proposals:
    """With world poses; the heading is the line's and what the change of d adds."""
    x, y, heading = line.place(s, d)
    ds, dd = np.diff(s, axis=1), np.diff(d, axis=1)
    slope = arctan2(np.where(ds > 1e-3, dd, 0.0), np.maximum(ds, 1e-3))
    return Proposals(s, d, speed, x, y, heading + np.concatenate((slope, slope[:, -1:]), axis=1))


def _beside(gone: Array, offset: Array, d0: float, over: Array) -> Array:
    left = 1.0 - np.minimum(gone / over, 1.0)
    found: Array = offset + (d0 - offset) * left * left
    return found


def _leader(s: Array, d: Array, o: Others, k: int, length: float, width: float) -> tuple[Array, Array]:
    """Gap to, and speed along the line of, the nearest road user in the way of each proposal; (inf, 0): none."""
    if not len(o.along):
        return np.full(len(s), np.inf), np.zeros(len(s))
    ahead = o.s[:, k] - s[:, None]
    gap = ahead - 0.5 * (length + o.length)
    inside = np.abs(o.d[:, k] - d[:, None]) < 0.5 * (width + o.width)
    gap = np.where(inside & (ahead > 0.0), gap, np.inf)
    who = np.argmin(gap, axis=1)
    rows = np.arange(len(s))
    return gap[rows, who], np.where(np.isfinite(gap[rows, who]), o.along[who], 0.0)
