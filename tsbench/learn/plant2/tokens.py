"""From an observation to the network's inputs. Sees no signs: masking them changes not one byte.

Among them a bird's-eye patch around the ego: drivable area, lane borders, route. The network is drawn once, north up;
a tick cuts the turned rectangle out of it. Units: m, rad.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from tsbench.geometry.polyline import Array, Polyline
from tsbench.learn.networks.shared_inputs import Image, cut, pack, repack
from tsbench.learn.plant2 import layout as at
from tsbench.learn.plant2.layout import PATCH_AHEAD_M, PATCH_CHANNELS, PATCH_COLUMNS, PATCH_M_PER_PX, PATCH_ROWS
from tsbench.planners.base import Observation
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.road_map import RoadMap
from tsbench.sim.world import ActorKind

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


Pose = tuple[float, float, float]
_CLASS = {
    int(ActorKind.CAR): at.CAR,
    int(ActorKind.BUS): at.BUS,
    int(ActorKind.BICYCLE): at.BICYCLE,
    int(ActorKind.PEDESTRIAN): at.PEDESTRIAN,
}
_NO_LIMIT_MPS = 22.2


class Tokeniser:
    """Makes tokens in one network. The slots of objects, up to side_m (m) to the left and right, are filled from the
    nearest on.
    """

    def __init__(self, network: RoadMap, side_m: float = at.RANGE_M) -> None:
        self.network, self.side_m = network, side_m
        self._patches = Patches(network)

    def tokens(self, o: Observation, pose: Pose | None = None) -> at.Records:
        """(1,) of `layout.TOKENS`; `pose`: as seen from there and not from where the ego is."""
        record: at.Records = np.zeros(1, dtype=at.TOKENS)
        self.fill(record[0], o, pose)
        return record

    def watch(self, o: Observation) -> None:
        """Called for every tick: there is nothing to remember."""

    def fill(self, record: at.Record, o: Observation, pose: Pose | None = None) -> list[int]:
        """Write the tokens into a zeroed record that has the fields of `layout.TOKENS`.

        Returns for each filled slot the object's row in `o.actors` (-1: an obstacle).
        """
        here = (o.ego.x, o.ego.y, o.ego.heading) if pose is None else pose
        rows, origins = nearest(o, here, self.side_m)
        if rows:
            count = len(rows)
            record["kinds"][:count] = [row[0] for row in rows]
            record["objects"][:count] = [row[1:] for row in rows]
        path, s = o.route.path, o.route.s
        record["route"] = points_ahead(path.line, s, at.ROUTE_AHEAD_M, here) / at.POSITION_SCALE_M
        record["limits"] = [
            min(path.limit_at(s + ahead), _NO_LIMIT_MPS) / at.SPEED_SCALE_MPS for ahead in at.LIMIT_AHEAD_M
        ]
        record["patch"] = self._patches.cut(path, *here)
        return origins


def nearest(o: Observation, pose: Pose, side_m: float) -> tuple[list[tuple[float, ...]], list[int]]:
    """Object rows (class, then features), nearest first, and for each its row in `o.actors` (-1: an obstacle)."""
    x0, y0, heading = pose
    c, s = math.cos(heading), math.sin(heading)
    found: list[tuple[float, int, int, float, float, float, float, float, float]] = []
    speeds, kinds = o.actors.speed.tolist(), o.actors.kind.tolist()
    bodies = [(k, _CLASS[kinds[k]], speeds[k], box) for k, box in enumerate(o.actors.boxes)]
    bodies += [(-1, at.STATIC, 0.0, (b.x, b.y, b.heading, b.length, b.width)) for b in o.obstacles]
    for k, kind, speed, (x, y, h, length, width) in bodies:
        dx, dy = x - x0, y - y0
        u, v = c * dx + s * dy, c * dy - s * dx
        if -at.RANGE_M <= u <= at.AHEAD_FACTOR * at.RANGE_M and abs(v) <= side_m:
            found.append((u * u + v * v, k, kind, u, v, h - heading, speed, length, width))
    found.sort()
    rows: list[tuple[float, ...]] = [
        (
            kind,
            u / at.POSITION_SCALE_M,
            v / at.POSITION_SCALE_M,
            math.cos(yaw),
            math.sin(yaw),
            speed / at.SPEED_SCALE_MPS,
            length / at.LENGTH_SCALE_M,
            width / at.WIDTH_SCALE_M,
        )
        for _, _, kind, u, v, yaw, speed, length, width in found[: at.OBJECTS]
    ]
    return rows, [entry[1] for entry in found[: at.OBJECTS]]


def points_ahead(line: Polyline, s: float, ahead: Sequence[float], pose: Pose) -> Array:
    """(k, 2) points of a line so far (m) ahead of arc length s, in the pose's frame."""
    return to_frame(np.array([line.point_at(s + metres) for metres in ahead]), pose)


def to_frame(points: Array, pose: Pose) -> Array:
    """(k, 2) world points in the frame of a pose."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = points[:, 0] - pose[0], points[:, 1] - pose[1]
    return np.column_stack((c * dx + s * dy, c * dy - s * dx))
