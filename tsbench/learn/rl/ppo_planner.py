"""`ppo`: 275 numbers through an MLP of 256 and 256 with tanh, whose Gaussian is drawn from. Sign-blind.

Source of the numbers: docs/planners.md. Parts and sizes are MetaDrive's (Li et al., arXiv 2109.12674), what is in them
is not: that is `tsbench.bridges.metadrive.MetaDriveEyes`. All are about -1..1, float32:

* 9 of the ego: speed, acceleration, steering, yaw rate, offset from the route, heading against it, room to the left and
  to the right, speed that bends and the road's own limits allow
* 10 of the navigation: four points of the route (forward, left) each over its distance ahead; way to go (over 100 m);
  limit
* 16 of neighbours: the four that come closest, the first obstacle among them: place (forward, left, over 50 m), speed
  against the ego (over 20 m/s)
* 240 of the lidar: distances over 50 m from the ego's centre, ray 0 ahead, counter-clockwise

For the lidar everything is segments. A segment seen from the ego covers an interval of angles, so only the rays in it
are cut: a few rays a segment instead of all rays with all segments. Units: m, rad.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
import shapely

from tsbench.geometry.elementary import arctan2, exp
from tsbench.geometry.overlap import strip
from tsbench.geometry.polyline import Array
from tsbench.learn.fixed_point import Linear, Parameters, snap, tanh
from tsbench.learn.rl.actions import DRAW, TWO_ACTIONS, LearnedPlanner, normal_quantile
from tsbench.learn.shared_inputs import Recent, RouteSpeed, ahead, clip, motion, on_route, pace
from tsbench.planners.base import Infer, PlannerContext, Records
from tsbench.planners.observation import Observation
from tsbench.planners.weights import Tensors, fitted
from tsbench.roads.road_map import RoadMap
from tsbench.sim.scene import Obstacle

# Lanes side by side leave slits of a centimetre or so: they are no edges.
_SLIT_M = 0.15
_COARSE_M = 0.15


def road_area(network: RoadMap) -> shapely.Geometry:
    """Union of all lane strips and junction areas, without the slits between them."""
    parts = [strip(lane.line, lane.width) for lane in network.lanes]
    parts += [shapely.Polygon(j.polygon) for j in network.junctions.values() if len(j.polygon) >= 3]
    wide = shapely.buffer(shapely.make_valid(np.array(parts, dtype=object)), _SLIT_M, join_style="mitre")
    return shapely.buffer(shapely.union_all(wide), -_SLIT_M, join_style="mitre")


def road_edges(network: RoadMap) -> Array:
    """(n, 4) segments x0, y0, x1, y1 of the outline of `road_area`; made once per network."""
    area = shapely.simplify(road_area(network), _COARSE_M)
    chunks = []
    for part in shapely.get_parts(area):
        if part.geom_type != "Polygon":
            continue
        for ring in (part.exterior, *part.interiors):
            xy = shapely.get_coordinates(ring)
            chunks.append(np.hstack((xy[:-1], xy[1:])))
    return np.vstack(chunks) if chunks else np.empty((0, 4))


RAYS = 240
REACH_M = 50.0
_STEP_RAD = 2.0 * math.pi / RAYS
# Edges of the road are sorted out anew after so many metres.
_STRIDE_M = 8.0
_ALONG, _BESIDE = np.array([0.5, -0.5, -0.5, 0.5]), np.array([0.5, 0.5, -0.5, -0.5])
_COS, _SIN = (np.array([f(_STEP_RAD * k) for k in range(RAYS)]) for f in (math.cos, math.sin))


class Lidar:
    """One episode's lidar. edges: (n, 4) segments x0, y0, x1, y1 of the road's outline."""

    def __init__(self, edges: Array) -> None:
        # Rows x0, x1, y0, y1: the ends of segments as the cast takes them.
        self._edges = np.ascontiguousarray(edges.T[[0, 2, 1, 3]])
        x0, x1, y0, y1 = self._edges
        self._mx, self._my = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
        self._reach2 = (0.5 * np.hypot(x1 - x0, y1 - y0) + REACH_M + _STRIDE_M) ** 2
        self._near = self._edges[:, :0]
        self._at = (math.inf, math.inf)
        self._fixed: dict[str, Array] = {}

    def scan(self, observation: Observation) -> Array:
        """(240,) distance from the ego's centre, at most 50; ray 0 straight ahead, then counter-clockwise."""
        ego = observation.ego
        parts = [self._road(ego.x, ego.y)]
        boxes = observation.actors.boxes
        if boxes:
            parts.append(_outlines(np.array(boxes)))
        parts += [self._outline(o) for o in observation.obstacles]
        return _cast(np.concatenate(parts, axis=1), ego.x, ego.y, ego.heading)

    def _road(self, x: float, y: float) -> Array:
        """Edges that may be within reach; a few too many, which changes no ray."""
        if math.hypot(x - self._at[0], y - self._at[1]) > _STRIDE_M:
            dx, dy = self._mx - x, self._my - y
            self._near = self._edges[:, dx * dx + dy * dy <= self._reach2]
            self._at = (x, y)
        return self._near

    def _outline(self, o: Obstacle) -> Array:
        found = self._fixed.get(o.id)
        if found is None:
            found = self._fixed[o.id] = _outlines(np.array([[o.x, o.y, o.heading, o.length, o.width]]))
        return found


def _outlines(boxes: Array) -> Array:
    """(4, 4 n) ends x0, x1, y0, y1 of the sides of n rectangles (x, y, heading, length, width)."""
    x, y, heading, length, width = boxes.T[:, :, None]
    c, s = (np.array([[f(h)] for h in heading[:, 0].tolist()]) for f in (math.cos, math.sin))
    along, beside = length * _ALONG, width * _BESIDE
    px, py = x + c * along - s * beside, y + s * along + c * beside
    out = np.empty((4, len(boxes), 4))
    out[0], out[1, :, :3], out[1, :, 3] = px, px[:, 1:], px[:, 0]
    out[2], out[3, :, :3], out[3, :, 3] = py, py[:, 1:], py[:, 0]
    return out.reshape(4, -1)


def _cast(ends: Array, x: float, y: float, heading: float) -> Array:
    c, s = math.cos(heading), math.sin(heading)
    dx, dy = ends[:2] - x, ends[2:] - y
    (x0, x1), (y0, y1) = c * dx + s * dy, c * dy - s * dx
    ex, ey = x1 - x0, y1 - y0
    cross = x0 * ey - y0 * ex
    # A segment is never wider than half a turn: its angle is that between the ends, from the one that comes first.
    left = cross >= 0.0
    first = arctan2(np.where(left, y0, y1), np.where(left, x0, x1)) / _STEP_RAD
    span = arctan2(np.abs(cross), x0 * x1 + y0 * y1) / _STEP_RAD
    begin = np.ceil(first).astype(np.int64)
    count = np.maximum(np.floor(first + span).astype(np.int64) - begin + 1, 0)
    last = np.cumsum(count)
    row = np.repeat(np.arange(len(count)), count)
    ray = (np.arange(len(row)) + (begin - last + count)[row]) % RAYS
    across = _COS[ray] * ey[row] - _SIN[ray] * ex[row]
    seen = np.full(RAYS, REACH_M)
    np.minimum.at(seen, ray, np.abs(cross)[row] / np.maximum(np.abs(across), 1e-9))
    return seen


Vector = npt.NDArray[np.float32]

EGO, NAVIGATION, NEIGHBOURS = 9, 10, 16
SIZE = EGO + NAVIGATION + NEIGHBOURS + RAYS

_AHEAD_M = (6.0, 14.0, 26.0, 42.0)
_NEIGHBOURS = NEIGHBOURS // 4
_NOBODY = (1.0, 0.0, 0.0, 0.0)
_ROOM_M, _PASSING_MPS = 10.0, 20.0
_FORESIGHT_S = 4.0
_PER_SECOND_M = 2.0


class VectorEncoder:
    """Makes the vectors of one episode after the other; keeps the outlines of the last few networks."""

    def __init__(self) -> None:
        self._outline: Recent[RoadMap, Array] = Recent(road_edges)
        self._lidar: Lidar
        self._speed: RouteSpeed

    def reset(self, context: PlannerContext) -> None:
        self._lidar = Lidar(self._outline(context.network))
        self._speed = RouteSpeed()

    def encode(self, observation: Observation) -> Vector:
        """(275,) float32."""
        seen = self._lidar.scan(observation)
        allowed, limit, way = pace(observation, self._speed)
        left, right = float(seen[RAYS // 4]), float(seen[3 * RAYS // 4])
        room = min(left / _ROOM_M, 1.0), min(right / _ROOM_M, 1.0)
        beyond = (value for distance in _AHEAD_M for value in ahead(observation, distance))
        numbers = [*motion(observation), *on_route(observation), *room, allowed, *beyond, way, limit]
        numbers += _neighbours(observation)
        out = np.empty(SIZE, dtype=np.float32)
        out[:-RAYS] = numbers
        np.divide(seen, REACH_M, out=out[-RAYS:], casting="same_kind")
        return out


def _neighbours(o: Observation) -> list[float]:
    """Those first whose nearest distance within four seconds, both going straight on, is small and soon.

    Of obstacles the first alone, which a row of cones and the lidar's gaps make worth a place.
    """
    ego = o.ego
    c, s = math.cos(ego.heading), math.sin(ego.heading)

    def seen(x: float, y: float, vx: float, vy: float) -> tuple[float, float, float, float, float]:
        dx, dy, ux, uy = x - ego.x, y - ego.y, vx - ego.speed * c, vy - ego.speed * s
        fast = ux * ux + uy * uy
        soon = min(max(-(dx * ux + dy * uy) / fast, 0.0), _FORESIGHT_S) if fast > 1e-6 else 0.0
        rank = math.hypot(dx + ux * soon, dy + uy * soon) + _PER_SECOND_M * soon
        return rank, c * dx + s * dy, c * dy - s * dx, c * ux + s * uy, c * uy - s * ux

    bodies = [
        seen(x, y, speed * math.cos(heading), speed * math.sin(heading))
        for (x, y, heading, _, _), speed in zip(o.actors.boxes, o.actors.speed.tolist(), strict=True)
        if (x - ego.x) ** 2 + (y - ego.y) ** 2 <= REACH_M * REACH_M
    ]
    first = sorted(seen(thing.x, thing.y, 0.0, 0.0) for thing in o.obstacles)[:1]
    bodies += [body for body in first if math.hypot(body[1], body[2]) <= REACH_M]
    bodies.sort()
    out: list[float] = []
    for _, dx, dy, ux, uy in bodies[:_NEIGHBOURS]:
        out += [dx / REACH_M, dy / REACH_M, clip(ux / _PASSING_MPS), clip(uy / _PASSING_MPS)]
    return out + list(_NOBODY) * (_NEIGHBOURS - min(len(bodies), _NEIGHBOURS))


WEIGHTS = "ppo"
RECORD = np.dtype([("vector", np.float32, (SIZE,)), DRAW])
# Inputs are about -1..1; what is beyond is cut, which bounds all that follows.
_MOST = 8.0


class Ppo(LearnedPlanner):
    """The planner."""

    inputs: ClassVar[np.dtype[Any]] = RECORD
    # A GPU gains nothing at this size.
    served_on: ClassVar[tuple[str, ...]] = ()

    def __init__(self, infer: Infer | None = None, folder: Path | None = None) -> None:
        super().__init__(infer, folder)
        self._encoder = VectorEncoder()

    @staticmethod
    def network(device: str, folder: Path | None = None) -> Infer:  # noqa: ARG004
        """The MLP, on the CPU whatever the device."""
        return fitted(WEIGHTS, folder, _network)

    def reset(self, context: PlannerContext) -> None:
        super().reset(context)
        self._encoder.reset(context)

    def fill(self, record: Records, observation: Observation) -> None:
        record["vector"][0] = self._encoder.encode(observation)


def _network(weights: Tensors) -> Infer:
    of = Parameters(weights)
    first = Linear(*of.linear("hidden.0"), bound=_MOST, snapped=None)
    second, action = (Linear(*of.linear(name), bound=1.0, snapped=None) for name in ("hidden.1", "action"))
    width = exp(of.take("action.log_std").astype(np.float64))
    of.end()
    if (first.weight.shape[1], action.weight.shape[0]) != (SIZE, len(width)):
        raise ValueError(f"{first.weight.shape[1]} inputs, {action.weight.shape[0]} actions")

    def infer(records: Records) -> Records:
        x = snap(np.clip(records["vector"].astype(np.float64), -_MOST, _MOST))
        mean = action(tanh(second(tanh(first(x)))))
        answers = np.empty(len(records), dtype=TWO_ACTIONS)
        answers["action"] = mean + width * normal_quantile(records["draw"])
        return answers

    return infer
