"""`carl`: a bird's-eye raster through a small CNN; its Beta densities are drawn from. Blind to signs.

The raster has nine channels, 2 px/m, the ego's heading up. Source: docs/planners.md; Jaeger et al., "CaRL", arXiv
2504.17838, whose raster is 256 x 256. Here it is 128 x 128: 48 m ahead, 16 m behind and 32 m to each side, which a CPU
can learn from. The channels keep the reference's layout:

0 drivable, 1 route, 2 lane lines, 3 lights (the maps have none), 4 stop signs (empty: no sign is seen), 5 speed limits
(the road's own, 255 = 22.2 m/s), 6 vehicles (brighter when faster, with a trail of where a second takes them),
7 pedestrians and static, 8 ego.

What stands still is drawn once per network, the route once per path; each tick turns them with one warp.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

import cv2
import numpy as np
import numpy.typing as npt

from tsbench.geometry.elementary import exp, log
from tsbench.geometry.polyline import Array
from tsbench.learn.fixed_point import BITS, LARGEST, Convolution, Linear, Parameters, rectified, snap
from tsbench.learn.rl.actions import DRAW, TWO_ACTIONS, LearnedPlanner, beta_quantile
from tsbench.learn.shared_inputs import (
    CHANNELS,
    MEASUREMENTS,
    PIXELS,
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
from tsbench.planners.base import Infer, PlannerContext, Records
from tsbench.planners.observation import Observation
from tsbench.planners.weights import fitted
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.road_map import RoadMap
from tsbench.sim.ego import MAX_SPEED_MPS
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M, ActorKind, Box

Raster = npt.NDArray[np.uint8]
Measured = npt.NDArray[np.float32]

PX_PER_M = 2.0
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
        """Motion 4, route 2, pace 3 (`shared_inputs`), and how far left the route is 14 m on."""
        numbers = (*motion(o), *on_route(o), *pace(o, self._speed), ahead(o, _AHEAD_M)[1])
        return np.array(numbers, dtype=np.float32)

    def raster(self, o: Observation) -> Raster:
        ego = o.ego
        c, s = math.cos(ego.heading), math.sin(ego.heading)
        out = self._blank.copy()
        px, py = (ego.x - self._ground.low[0]) * PX_PER_M, (ego.y - self._ground.low[1]) * PX_PER_M
        to_world = np.array([[s, -c, px + c * _ROW - s * _COLUMN], [-c, -s, py + s * _ROW + c * _COLUMN]])
        out[list(_STATIC)] = cut(self._image(o.route.path), to_world, len(_STATIC), PIXELS, PIXELS)
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


# Measurements are about -1..1; what is beyond is cut, which bounds all that follows.
_MOST = 8.0
_STRIDES = (4, 2, 2)


class CarlEngine:
    """(b,) records to (b, 2, 2) parameters of the Beta densities of both actions: without torch, the same actions in
    the same bits, on every CPU and in every batch.

    Raises KeyError or ValueError for weights that are not those of the network.
    """

    def __init__(self, weights: Mapping[str, npt.NDArray[Any]]) -> None:
        of = Parameters(weights)
        self._convolutions: list[Convolution] = []
        # Pixels are whole numbers: the first weights may be so much finer.
        bound, bits, scale = float(_FULL), 0, float(_FULL)
        for k, stride in enumerate(_STRIDES):
            weight, bias = of.linear(f"trunk.image.{2 * k}")
            self._convolutions.append(Convolution(weight / scale, bias, stride, bound=bound, bits=bits))
            bound, bits, scale = LARGEST, BITS, 1.0
        self._wide, self._joint = (Linear(*of.linear(f"trunk.{name}.0"), bound=LARGEST) for name in ("wide", "joint"))
        self._measured = Linear(*of.linear("trunk.measured.0"), bound=_MOST)
        self._action = Linear(*of.linear("action"), bound=LARGEST, snapped=None)
        of.end()
        if self._measured.weight.shape[1] != MEASUREMENTS:
            raise ValueError(f"{self._measured.weight.shape[1]} measurements")

    def __call__(self, records: Records) -> Array:
        x: Any = records["bev"].transpose(0, 2, 3, 1)
        for convolution in self._convolutions:
            x = rectified(convolution(x))
        seen = rectified(self._wide(x.transpose(0, 3, 1, 2).reshape(len(x), -1)))
        told = snap(np.clip(records["measurements"].astype(np.float64), -_MOST, _MOST))
        latent = rectified(self._joint(np.concatenate([seen, rectified(self._measured(told))], axis=1)))
        raw = self._action(latent)
        # 1 + softplus: each parameter is above 1.
        return (1.0 + np.maximum(raw, 0.0) + log(1.0 + exp(-np.abs(raw)))).reshape(-1, 2, 2)


WEIGHTS = "carl"
RECORD = np.dtype([("bev", np.uint8, (CHANNELS, PIXELS, PIXELS)), ("measurements", np.float32, (MEASUREMENTS,)), DRAW])


class Carl(LearnedPlanner):
    """The planner."""

    inputs: ClassVar[np.dtype[Any]] = RECORD
    served_on: ClassVar[tuple[str, ...]] = ("cuda",)

    def __init__(self, infer: Infer | None = None, folder: Path | None = None) -> None:
        super().__init__(infer, folder)
        self._encoder = RasterEncoder()

    @staticmethod
    def network(device: str, folder: Path | None = None) -> Infer:
        """The CNN: by the engine on a CPU, by torch on a GPU."""
        densities: Callable[[Records], Array]
        if device == "cpu":
            densities = fitted(WEIGHTS, folder, CarlEngine)
        else:
            from tsbench.learn.rl.policy import densities_by_torch

            densities = fitted(WEIGHTS, folder, lambda weights: densities_by_torch(weights, device))

        def infer(records: Records) -> Records:
            answers = np.empty(len(records), dtype=TWO_ACTIONS)
            found, draws = densities(records).tolist(), records["draw"].tolist()
            answers["action"] = [
                [2.0 * beta_quantile(a, b, p) - 1.0 for a, b, p in zip(*pair, draw, strict=True)]
                for pair, draw in zip(found, draws, strict=True)
            ]
            return answers

        return infer

    def reset(self, context: PlannerContext) -> None:
        super().reset(context)
        self._encoder.reset(context)

    def fill(self, record: Records, observation: Observation) -> None:
        record["bev"][0], record["measurements"][0] = self._encoder.encode(observation)
