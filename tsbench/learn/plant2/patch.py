"""A bird's-eye patch around the ego: drivable area, lane borders, route. Units: m, rad.

The network is drawn once, north up; a tick cuts the turned rectangle out of it.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from tsbench.learn.networks.cutout import Image, cut, pack, repack
from tsbench.learn.plant2.layout import PATCH_AHEAD_M, PATCH_CHANNELS, PATCH_COLUMNS, PATCH_M_PER_PX, PATCH_ROWS
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.road_map import RoadMap

_PX_PER_M = 2.0
_MARGIN_M = 70.0
# Fractions of a pixel that OpenCV's drawing is told, as a power of two.
_SHIFT = 4
_ROUTE_WIDTH_M = 2.0


class Patches:
    """Patches of one network. `cut` keeps the drawn route while the path stays the same object."""

    def __init__(self, network: RoadMap) -> None:
        points = np.concatenate([lane.line.points for lane in network.lanes])
        self._origin = points.min(axis=0) - _MARGIN_M
        width, height = np.ceil((points.max(axis=0) + _MARGIN_M - self._origin) * _PX_PER_M).astype(int)
        self._shape = int(height), int(width)
        self._path: RoutePath | None = None
        self._drawing = pack([*self._roads(network), self._empty()])

    def _empty(self) -> Image:
        return np.zeros(self._shape, dtype=np.uint8)

    def _roads(self, network: RoadMap) -> tuple[Image, Image]:
        ground, borders = self._empty(), self._empty()
        for junction in network.junctions.values():
            if len(junction.polygon) >= 3:
                cv2.fillPoly(ground, [self._pixels(junction.polygon)], 255, shift=_SHIFT)
        for lane in network.lanes:
            left, right = lane.line.beside(0.5 * lane.width), lane.line.beside(-0.5 * lane.width)
            cv2.fillPoly(ground, [self._pixels(np.vstack((left, right[::-1])))], 255, shift=_SHIFT)
            if not lane.internal:
                lines = [self._pixels(left), self._pixels(right)]
                cv2.polylines(borders, lines, False, 255, 1, cv2.LINE_AA, _SHIFT)
        return ground, borders

    def _pixels(self, points: npt.NDArray[np.float64]) -> npt.NDArray[np.int32]:
        fine = (points - self._origin) * (_PX_PER_M * (1 << _SHIFT))
        pixels: npt.NDArray[np.int32] = np.round(fine).astype(np.int32).reshape(-1, 1, 2)
        return pixels

    def cut(self, path: RoutePath, x: float, y: float, heading: float) -> Image:
        """(channels, rows, columns) around a pose."""
        if path is not self._path:
            self._path = path
            route = self._empty()
            thick = round(_ROUTE_WIDTH_M * _PX_PER_M)
            line = [self._pixels(path.line.points)]
            cv2.polylines(route, line, False, 255, thick, cv2.LINE_AA, _SHIFT)
            repack(self._drawing, 2, route)
        return cut(self._drawing, self._matrix(x, y, heading), PATCH_CHANNELS, PATCH_ROWS, PATCH_COLUMNS)

    def _matrix(self, x: float, y: float, heading: float) -> npt.NDArray[np.float64]:
        """From a pixel of the patch (column, row) to one of the drawing."""
        step = PATCH_M_PER_PX * _PX_PER_M
        c, s = math.cos(heading), math.sin(heading)
        # Where the middle of pixel (0, 0) is, seen from the ego.
        ahead = PATCH_AHEAD_M - 0.5 * PATCH_M_PER_PX
        left = (0.5 * PATCH_COLUMNS - 0.5) * PATCH_M_PER_PX
        px = (x + c * ahead - s * left - self._origin[0]) * _PX_PER_M
        py = (y + s * ahead + c * left - self._origin[1]) * _PX_PER_M
        return np.array([[s * step, -c * step, px], [-c * step, -s * step, py]])
