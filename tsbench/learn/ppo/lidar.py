"""A lidar of 240 rays against the outlines of road users, obstacles and the road. Units: m, rad.

Everything is segments. A segment seen from the ego covers an interval of angles, so only the rays in it are cut:
a few rays a segment instead of all rays with all segments.
"""

from __future__ import annotations

import math

import numpy as np
import shapely

from tsbench.geometry.elementary import arctan2
from tsbench.geometry.overlap import strip
from tsbench.geometry.polyline import Array
from tsbench.planners.base import Observation
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
