"""The bird's-eye raster that `carl` sees: nine channels, 2 px/m, the ego's heading up. Blind to signs.

Source: docs/planners.md; Jaeger et al., "CaRL", arXiv 2504.17838, whose raster is 256 x 256. Here it is 128 x 128:
48 m ahead, 16 m behind and 32 m to each side, which a CPU can learn from. The channels keep the reference's layout:

0 drivable, 1 route, 2 lane lines, 3 lights (the maps have none), 4 stop signs (empty: no sign is seen), 5 speed limits
(the road's own, 255 = 22.2 m/s), 6 vehicles (brighter when faster, with a trail of where a second takes them),
7 pedestrians and static, 8 ego.

What stands still is drawn once per network, the route once per path; each tick turns them with one warp.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from tsbench.geometry.polyline import Array
from tsbench.learn.networks.shared_inputs import (
    Packed,
    Recent,
    RouteSpeed,
    ahead,
    cut,
    motion,
    on_route,
    pace,
    pack,
    repack,
)
from tsbench.planners.base import Observation, PlannerContext
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.road_map import RoadMap
from tsbench.sim.ego import MAX_SPEED_MPS
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M, ActorKind, Box

Raster = npt.NDArray[np.uint8]
Measured = npt.NDArray[np.float32]

CHANNELS, PIXELS, PX_PER_M = 9, 128, 2.0
MEASUREMENTS = 10

DRIVABLE, ROUTE, LINES, LIGHTS, STOPS, LIMITS, VEHICLES, OTHERS, EGO = range(CHANNELS)
_STATIC = (DRIVABLE, ROUTE, LINES, LIMITS)
_ROW, _COLUMN = 96.0, 64.0
_ROUTE_M = 2.0
_FULL, _STANDING, _TRAIL, _FIXED = 255, 120, 80, 160
_FAST_MPS = 15.0
_AHEAD_M = 14.0
_MARGIN_M = 4.0
_SIGHT_M = 62.0
# cv2 takes coordinates in sixteenths of a pixel.
_SHIFT, _SUB = 4, 16


class _Ground:
    """What stands still of one network, in pixels of the network's own frame."""

    def __init__(self, network: RoadMap) -> None:
        lanes = network.lanes
        points = np.vstack([lane.line.points for lane in lanes])
        self.low: Array = points.min(axis=0) - _MARGIN_M - 4.0
        wide, high = ((points.max(axis=0) - self.low + _MARGIN_M + 4.0) * PX_PER_M).astype(int) + 1
        self._shape = high, wide
        drivable, lines, limits = (np.zeros((high, wide), dtype=np.uint8) for _ in range(3))
        for junction in network.junctions.values():
            if len(junction.polygon) >= 3:
                cv2.fillPoly(drivable, [self._pixels(junction.polygon)], _FULL, shift=_SHIFT)
        for lane in lanes:
            thick = max(round(lane.width * PX_PER_M), 1)
            path = [self._pixels(lane.line.points)]
            cv2.polylines(drivable, path, False, _FULL, thick, shift=_SHIFT)
            shade = min(round(_FULL * lane.speed / MAX_SPEED_MPS), _FULL)
            cv2.polylines(limits, path, False, shade, thick, shift=_SHIFT)
        for lane in lanes:
            if not lane.internal:
                sides = [self._pixels(lane.line.beside(side * lane.width / 2)) for side in (-1, 1)]
                cv2.polylines(lines, sides, False, _FULL, 1, shift=_SHIFT)
        self._image = pack([drivable, np.zeros((high, wide), dtype=np.uint8), lines, limits])

    def _pixels(self, xy: Array) -> npt.NDArray[np.int32]:
        return np.round((xy - self.low) * (PX_PER_M * _SUB)).astype(np.int32)

    def with_route(self, path: RoutePath) -> Packed:
        route = np.zeros(self._shape, dtype=np.uint8)
        thick = round(_ROUTE_M * PX_PER_M)
        cv2.polylines(route, [self._pixels(path.line.points)], False, _FULL, thick, shift=_SHIFT)
        image = self._image.copy()
        repack(image, _STATIC.index(ROUTE), route)
        return image


class RasterEncoder:
    """Makes the rasters of one episode after the other; keeps the ground of the last few networks."""

    def __init__(self) -> None:
        self._ground_of: Recent[RoadMap, _Ground] = Recent(_Ground)
        self._ground: _Ground
        self._speed: RouteSpeed
        self._image: Recent[RoutePath, Packed]
        self._blank = np.zeros((CHANNELS, PIXELS, PIXELS), dtype=np.uint8)
        body = _corners((0.0, 0.0, 0.0, EGO_LENGTH_M, EGO_WIDTH_M), 0.0, 0.0, 1.0, 0.0)
        cv2.fillConvexPoly(self._blank[EGO], body, _FULL, shift=_SHIFT)

    def reset(self, context: PlannerContext) -> None:
        self._ground = self._ground_of(context.network)
        self._image = Recent(self._ground.with_route)
        self._speed = RouteSpeed()

    def encode(self, observation: Observation) -> tuple[Raster, Measured]:
        """(9, 128, 128) uint8, and (10,) float32 measurements."""
        return self.raster(observation), self.measure(observation)

    def measure(self, o: Observation) -> Measured:
        """Motion 4, route 2, pace 3 (`networks.shared_inputs`), and how far left the route is 14 m on."""
        numbers = (*motion(o), *on_route(o), *pace(o, self._speed), ahead(o, _AHEAD_M)[1])
        return np.array(numbers, dtype=np.float32)

    def raster(self, o: Observation) -> Raster:
        ego = o.ego
        c, s = math.cos(ego.heading), math.sin(ego.heading)
        out = self._blank.copy()
        turned = self._warp(self._image(o.route.path), ego.x, ego.y, c, s)
        out[list(_STATIC)] = turned
        kinds, speeds = o.actors.kind.tolist(), o.actors.speed.tolist()
        for box, kind, speed in zip(o.actors.boxes, kinds, speeds, strict=True):
            if abs(box[0] - ego.x) + abs(box[1] - ego.y) > 2.0 * _SIGHT_M:
                continue
            body = _corners(box, ego.x, ego.y, c, s)
            if kind == ActorKind.PEDESTRIAN:
                cv2.fillConvexPoly(out[OTHERS], body, _FULL, shift=_SHIFT)
                continue
            front, shade = ((body[0] + body[3]) // 2, _STANDING + (_FULL - _STANDING) * min(speed / _FAST_MPS, 1.0))
            # Screen rows grow backwards: a heading turns into column and row by minus sine and minus cosine.
            turn, far = box[2] - ego.heading, speed * PX_PER_M * _SUB
            tip = (int(front[0] - far * math.sin(turn)), int(front[1] - far * math.cos(turn)))
            cv2.line(out[VEHICLES], (int(front[0]), int(front[1])), tip, _TRAIL, 1, shift=_SHIFT)
            cv2.fillConvexPoly(out[VEHICLES], body, int(shade), shift=_SHIFT)
        for thing in o.obstacles:
            box = (thing.x, thing.y, thing.heading, thing.length, thing.width)
            cv2.fillConvexPoly(out[OTHERS], _corners(box, ego.x, ego.y, c, s), _FIXED, shift=_SHIFT)
        return out

    def _warp(self, image: Packed, x: float, y: float, c: float, s: float) -> Raster:
        px, py = (x - self._ground.low[0]) * PX_PER_M, (y - self._ground.low[1]) * PX_PER_M
        to_world = np.array([[s, -c, px + c * _ROW - s * _COLUMN], [-c, -s, py + s * _ROW + c * _COLUMN]])
        return cut(image, to_world, len(_STATIC), PIXELS, PIXELS)


def _corners(box: Box, x: float, y: float, c: float, s: float) -> npt.NDArray[np.int32]:
    """(4, 2) corners in sixteenths of pixels: front left, rear left, rear right, front right."""
    dx, dy = box[0] - x, box[1] - y
    forward, left = c * dx + s * dy, c * dy - s * dx
    ch, sh = math.cos(box[2]), math.sin(box[2])
    cr, sr = ch * c + sh * s, sh * c - ch * s
    half_l, half_w = 0.5 * box[3], 0.5 * box[4]
    fx, fy, lx, ly = cr * half_l, sr * half_l, -sr * half_w, cr * half_w
    u, v, k = _COLUMN * _SUB, _ROW * _SUB, PX_PER_M * _SUB
    return np.array(
        [
            [u - k * (left + fy + ly), v - k * (forward + fx + lx)],
            [u - k * (left - fy + ly), v - k * (forward - fx + lx)],
            [u - k * (left - fy - ly), v - k * (forward - fx - lx)],
            [u - k * (left + fy - ly), v - k * (forward + fx - lx)],
        ],
        dtype=np.float64,
    ).astype(np.int32)
