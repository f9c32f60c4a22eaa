"""Where the ego is, from geometry alone: lane, arc length, lateral offset, on or off the road. Units: m, rad."""

from __future__ import annotations

import math

import numpy as np

from tsbench.geometry.polyline import Array
from tsbench.roads.network import RoadNetwork

_MARGIN_M = 1e-6
# Lanes side by side leave slits: netconvert rounds to centimetres, and offset lines part at bends.
_SLIT_M = 0.25
# Lanes one behind the other leave seams of a centimetre, which the junction's area may not cover either.
_SEAM_M = 0.03


def inside_polygon(x: float, y: float, polygon: Array) -> bool:
    """Is the point inside the (k, 2) polygon? Even-odd rule."""
    xs, ys = polygon[:, 0], polygon[:, 1]
    xn, yn = np.roll(xs, -1), np.roll(ys, -1)
    crosses = (ys > y) != (yn > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = xs + (y - ys) * (xn - xs) / (yn - ys)
    return bool(np.count_nonzero(crosses & (x < at)) % 2)


class LaneLocator:
    """Finds the lane that a point with a heading is on, cheaply when it is on the same lane as before."""

    def __init__(self, network: RoadNetwork) -> None:
        self.network = network
        self._drivable = [
            lane for lane in network.lanes if any(lane.permits(c) for c in ("passenger", "bus", "bicycle"))
        ]
        boxes = [
            (*(lane.line.points.min(axis=0) - lane.width), *(lane.line.points.max(axis=0) + lane.width))
            for lane in self._drivable
        ]
        self._boxes = np.asarray(boxes, dtype=np.float64)
        # Both directions of a road run between the same two junctions.
        self._road = {
            e.id: (e.id,) if e.internal else tuple(sorted((e.source, e.target))) for e in network.edges.values()
        }
        self._areas = [j.polygon for j in network.junctions.values() if len(j.polygon) >= 3]

    def locate(self, x: float, y: float, heading: float, last: int) -> tuple[int, float, float, bool]:
        """(lane, s, d, on_road); lane -1 (s = d = 0) where no lane strip holds the point.

        Among overlapping strips the one that fits heading and centre best wins; the lane of the tick before
        is kept while the point is well inside it.
        """
        if last >= 0:
            lane = self.network.lanes[last]
            s, d = lane.line.project(x, y)
            if not lane.internal and abs(d) <= lane.width / 2 and 0.0 <= s <= lane.line.length:
                return last, s, d, True
        best, best_cost, place = -1, math.inf, (0.0, 0.0)
        b = self._boxes
        hits = np.nonzero((x >= b[:, 0]) & (y >= b[:, 1]) & (x <= b[:, 2]) & (y <= b[:, 3]))[0]
        for k in hits.tolist():
            lane = self._drivable[k]
            s, d = lane.line.project(x, y)
            if abs(d) > lane.width / 2 + _MARGIN_M or not -_MARGIN_M <= s <= lane.line.length + _MARGIN_M:
                continue
            turn = 1.0 - math.cos(heading - lane.line.heading_at(s))
            # Paths through a junction overlap at first: stay on the one that was taken.
            cost = abs(d) + 4.0 * turn + (0.0 if lane.index == last else 0.3)
            if cost < best_cost:
                best, best_cost, place = lane.index, cost, (s, d)
        if best < 0:
            best, place = self._in_slit(x, y, hits.tolist())
        if best >= 0:
            return best, place[0], place[1], True
        return -1, 0.0, 0.0, any(inside_polygon(x, y, area) for area in self._areas)

    def _in_slit(self, x: float, y: float, hits: list[int]) -> tuple[int, tuple[float, float]]:
        """The nearer of two lanes of one road that both come within a slit's width of the point; else -1."""
        near: dict[tuple[str, ...], list[tuple[float, int, float, float]]] = {}
        for k in hits:
            lane = self._drivable[k]
            s, d = lane.line.project(x, y)
            beside = abs(d) - lane.width / 2
            if beside <= 0.0 and -_SEAM_M <= s <= lane.line.length + _SEAM_M:
                return lane.index, (s, d)
            if beside <= _SLIT_M and -_SLIT_M <= s <= lane.line.length + _SLIT_M:
                near.setdefault(self._road[lane.edge], []).append((beside, lane.index, s, d))
        between = [min(lanes) for lanes in near.values() if len(lanes) > 1]
        if not between:
            return -1, (0.0, 0.0)
        _, index, s, d = min(between)
        return index, (s, d)
