"""Polylines with arc length: the carrier of every Frenet frame. Units: m, rad."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tsbench.core.frozen import Frozen
from tsbench.geometry.elementary import arctan2

Array = npt.NDArray[np.float64]


class Polyline(Frozen):
    """An immutable polyline.

    Attributes
    ----------
    points : (n, 2) float64, n >= 2, consecutive points distinct.
    s : (n,) arc length at each point, s[0] = 0.
    length : total length in m.
    """

    points: Array
    s: Array
    length: float
    _x: tuple[float, ...]
    _y: tuple[float, ...]
    _s: tuple[float, ...]
    _seg: tuple[float, ...]
    _dx: tuple[float, ...]
    _dy: tuple[float, ...]
    _heading: tuple[float, ...]

    __slots__ = ("_dx", "_dy", "_heading", "_s", "_seg", "_x", "_y", "length", "points", "s")

    def __init__(self, points: npt.ArrayLike) -> None:
        raw = np.asarray(points, dtype=np.float64)
        if raw.ndim != 2 or raw.shape[1] != 2 or not np.all(np.isfinite(raw)):
            raise ValueError(f"a polyline needs finite (n, 2) points, not {raw.shape}")
        keep = np.ones(len(raw), dtype=bool)
        keep[1:] = np.hypot(*np.diff(raw, axis=0).T) > 1e-9
        clean = np.ascontiguousarray(raw[keep])
        if len(clean) < 2:
            raise ValueError("a polyline needs two distinct points")
        delta = np.diff(clean, axis=0)
        seg = np.hypot(delta[:, 0], delta[:, 1])
        along = np.concatenate(([0.0], np.cumsum(seg)))
        clean.setflags(write=False)
        along.setflags(write=False)
        # Plain numbers: scalar look-ups in a tick are several times faster than on small arrays.
        filled = {
            "points": clean,
            "s": along,
            "length": float(along[-1]),
            "_s": tuple(along.tolist()),
            "_x": tuple(clean[:, 0].tolist()),
            "_y": tuple(clean[:, 1].tolist()),
            "_dx": tuple((delta[:, 0] / seg).tolist()),
            "_dy": tuple((delta[:, 1] / seg).tolist()),
            "_seg": tuple(seg.tolist()),
            "_heading": tuple(arctan2(delta[:, 1], delta[:, 0]).tolist()),
        }
        for name, value in filled.items():
            object.__setattr__(self, name, value)

    def _segment(self, s: float) -> int:
        return min(max(bisect_right(self._s, s) - 1, 0), len(self._seg) - 1)

    def point_at(self, s: float, d: float = 0.0) -> tuple[float, float]:
        """The point at arc length `s`, `d` to the left; the ends are continued straight on."""
        i = self._segment(s)
        t = s - self._s[i]
        ux, uy = self._dx[i], self._dy[i]
        return self._x[i] + t * ux - d * uy, self._y[i] + t * uy + d * ux

    def heading_at(self, s: float) -> float:
        """Heading (rad, counter-clockwise from +x) of the segment at arc length `s`."""
        return self._heading[self._segment(s)]

    def project(self, x: float, y: float, lo: float = -math.inf, hi: float = math.inf) -> tuple[float, float]:
        """Frenet coordinates (s, d) of the nearest point with lo <= s <= hi; d > 0 is left.

        Beyond an end of the line, s goes on straight (s < 0 or s > length), so that a line crossing has
        a sign on both sides. `lo`/`hi` narrow the search to a window, for a point that moved a little.
        """
        first = 0 if lo <= 0.0 else self._segment(lo)
        last = len(self._seg) - 1 if hi >= self.length else self._segment(hi)
        best, best_i, best_t = math.inf, first, 0.0
        xs, ys, dxs, dys, seg = self._x, self._y, self._dx, self._dy, self._seg
        for i in range(first, last + 1):
            px, py = x - xs[i], y - ys[i]
            t = px * dxs[i] + py * dys[i]
            c = 0.0 if t < 0.0 else min(t, seg[i])
            ex, ey = px - c * dxs[i], py - c * dys[i]
            dist = ex * ex + ey * ey
            if dist < best:
                best, best_i, best_t = dist, i, t
        i, t = best_i, best_t
        if i > 0 and t < 0.0:
            t = 0.0
        elif i < len(seg) - 1 and t > seg[i]:
            t = seg[i]
        px, py = x - xs[i], y - ys[i]
        cross = dxs[i] * py - dys[i] * px
        if 0.0 <= t <= seg[i]:
            # At a corner the perpendicular foot is the vertex: the distance is to the vertex itself.
            return self._s[i] + t, math.copysign(math.sqrt(best), cross)
        return self._s[i] + t, cross

    def project_many(self, xy: Array) -> tuple[Array, Array]:
        """Vectorised `project` of (k, 2) points: arrays s (k,), d (k,)."""
        start = self.points[:-1]
        direction = np.stack((self._dx, self._dy), axis=1)
        seg = np.asarray(self._seg)
        rel = xy[:, None, :] - start[None]
        along = rel[..., 0] * direction[:, 0] + rel[..., 1] * direction[:, 1]
        clipped = np.clip(along, 0.0, seg)
        foot = rel - clipped[..., None] * direction
        dist = foot[..., 0] * foot[..., 0] + foot[..., 1] * foot[..., 1]
        i = np.argmin(dist, axis=1)
        rows = np.arange(len(xy))
        t = along[rows, i]
        cross = direction[i, 0] * rel[rows, i, 1] - direction[i, 1] * rel[rows, i, 0]
        before, after = (i == 0) & (t < 0.0), (i == len(seg) - 1) & (t > seg[i])
        beyond = before | after
        s = self.s[i] + np.where(beyond, t, clipped[rows, i])
        d = np.where(beyond, cross, np.copysign(np.sqrt(dist[rows, i]), cross))
        return s, d

    def slice(self, s0: float, s1: float) -> Polyline:
        """The part between two arc lengths (s0 < s1); both ends are continued straight if outside."""
        if not s1 - s0 > 1e-6:
            raise ValueError(f"empty slice [{s0}, {s1}]")
        inner = self.points[(self.s > s0 + 1e-9) & (self.s < s1 - 1e-9)]
        return Polyline(np.vstack((self.point_at(s0), inner, self.point_at(s1))))

    def beside(self, d: float) -> Array:
        """(n, 2) the line shifted by d to the left; corners are mitred, at most threefold."""
        delta = np.diff(self.points, axis=0)
        unit = delta / np.hypot(delta[:, 0], delta[:, 1])[:, None]
        normal = np.column_stack((-unit[:, 1], unit[:, 0]))
        bisector = np.vstack((normal[:1], normal[:-1] + normal[1:], normal[-1:]))
        size = np.hypot(bisector[:, 0], bisector[:, 1])[:, None]
        bisector = bisector / np.maximum(size, 1e-9)
        products = bisector * np.vstack((normal, normal[-1:]))
        cosine = products[:, 0] + products[:, 1]
        shifted: Array = self.points + bisector * (d / np.clip(cosine, 1 / 3, None))[:, None]
        return shifted

    def resampled(self, step: float) -> Polyline:
        """The same line with points every `step` metres (and its end)."""
        n = max(math.ceil(self.length / step), 1)
        at = np.linspace(0.0, self.length, n + 1)
        x = np.interp(at, self.s, self.points[:, 0])
        y = np.interp(at, self.s, self.points[:, 1])
        return Polyline(np.column_stack((x, y)))


def join(lines: Sequence[Polyline]) -> Polyline:
    return Polyline(np.vstack([line.points for line in lines]))


def bend_speed(line: Polyline, lateral: float) -> float:
    """Speed (m/s) on a line's tightest stretch of 4 m with `lateral` m/s2 sideways; inf where it does not bend."""
    headings = np.unwrap([line.heading_at(s) for s in np.arange(0.0, line.length, 2.0)])
    if len(headings) < 3:
        return math.inf
    curvature = float(np.max(np.abs(headings[2:] - headings[:-2])) / 4.0)
    return math.sqrt(lateral / curvature) if curvature else math.inf
