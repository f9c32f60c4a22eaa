"""The network's inputs as one NumPy record, and from an observation to them: what is stored for training is what is
driven with. `Tokeniser` sees no signs: masking them changes not one byte.

Frame: the ego's centre, x ahead, y left; m, m/s, rad, divided by the scales below. Among the inputs is a bird's-eye
patch around the ego: drivable area, lane borders, route. The network is drawn once, north up; a tick cuts the turned
rectangle out of it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from tsbench.core.errors import InputError
from tsbench.geometry.polyline import Array, Polyline
from tsbench.learn.shared_inputs import Image, cut, pack, repack
from tsbench.planners.observation import Observation
from tsbench.planners.weights import Network
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.road_map import RoadMap
from tsbench.sim.world import ActorKind

Records = npt.NDArray[np.void]
Record = np.void

# Classes of object tokens; 0 is an empty slot.
EMPTY, CAR, BUS, BICYCLE, PEDESTRIAN, STATIC = range(6)
OBJECT_CLASSES = 6
OBJECTS = 30
# x, y, cos and sin of the heading, speed, length, width: an angle as one number has a seam where traffic comes from.
OBJECT_FEATURES = 7
RANGE_M = 50.0
AHEAD_FACTOR = 2.0
# To the sides for `plant2-ft`: who crosses at 60 km/h comes 67 m in the 4 s that are to be left free.
SIGN_SIDE_M = 75.0

ROUTE_POINTS = 20
ROUTE_STEP_M = 1.0
ROUTE_AHEAD_M = tuple(ROUTE_STEP_M * (k + 1) for k in range(ROUTE_POINTS))
# The road's own limit here and this much farther along the route.
LIMIT_AHEAD_M = (0.0, 30.0)

# Bird's-eye patch: drivable area, lane borders, route; row 0 is farthest ahead, column 0 farthest left.
PATCH_CHANNELS = 3
PATCH_ROWS, PATCH_COLUMNS = 64, 32
PATCH_AHEAD_M = 48.0
PATCH_M_PER_PX = 1.0

# Sign tokens (`plant2-ft`): x, y, cos and sin of the direction it faces, value, lane.
SIGNS = 6
SIGN_FEATURES = 6
# Plates that hold (`plant2-ft`), remembered once out of sight: on the ego's way, and on another arm of its junction.
# Of each: value, lane, m ahead of the ego's centre (less than 0: passed), m from its front to the end of its lane,
# and whether it has stood for the plate.
HELD = 2
HELD_FEATURES = 5

# Ways to the destination by the exits ahead (`plant2-ft`): points so far along each (x, y), then cos and sin of the
# turn at the exit, metres to it, metres to the destination, and whether it is the navigation's.
WAYS = 4
# The route's points come first: a fine-tuning begins by reading them as it reads the route's.
WAY_AHEAD_M = (*ROUTE_AHEAD_M, 25.0, 30.0, 40.0, 60.0)
WAY_FACTS = 5
WAY_FEATURES = 2 * len(WAY_AHEAD_M) + WAY_FACTS

PATH_POINTS = 20
PATH_STEP_M = 1.0
WAYPOINTS = 8
WAYPOINT_S = 0.25
FORECAST_S = (1.0, 2.0)
# Speed classes (m/s). The first gap is narrow: with one of 0 to 4 m/s, crawling and standing look the same.
SPEEDS = (0.0, 1.0, 2.5, 5.0, 8.0, 11.0, 14.0, 18.0)

POSITION_SCALE_M = 50.0
SPEED_SCALE_MPS = 10.0
LENGTH_SCALE_M, WIDTH_SCALE_M = 5.0, 2.0
REMAINING_SCALE_M = 200.0

# Without padding, which would carry whatever lay in memory into files that have to be the same.
TOKENS = np.dtype(
    [
        ("objects", np.float32, (OBJECTS, OBJECT_FEATURES)),
        ("kinds", np.uint8, (OBJECTS,)),
        ("route", np.float32, (ROUTE_POINTS, 2)),
        ("limits", np.float32, (len(LIMIT_AHEAD_M),)),
        ("patch", np.uint8, (PATCH_CHANNELS, PATCH_ROWS, PATCH_COLUMNS)),
    ]
)
SIGN_TOKENS = np.dtype(
    [
        *((name, TOKENS.fields[name][0]) for name in TOKENS.names or ()),  # type: ignore[index]
        ("signs", np.float32, (SIGNS, SIGN_FEATURES)),
        ("sign_classes", np.uint8, (SIGNS,)),
        ("held", np.float32, (HELD, HELD_FEATURES)),
        ("held_classes", np.uint8, (HELD,)),
        ("ways", np.float32, (WAYS, WAY_FEATURES)),
        ("way_known", np.uint8, (WAYS,)),
    ]
)
# What the network answers: points in the ego's frame (m), and the target speed (m/s).
PLAN = np.dtype(
    [
        ("path", np.float32, (PATH_POINTS, 2)),
        ("waypoints", np.float32, (WAYPOINTS, 2)),
        ("speed", np.float64),
        ("standing", np.float64),
    ]
)


@dataclass(frozen=True, slots=True)
class Size:
    """Extents of a network. patch: channels of the patch encoder's stages; () = tiles. dropout: of the encoder."""

    layers: int
    width: int
    heads: int
    feedforward: int
    patch: tuple[int, ...]
    hidden: int
    dropout: float


SIZES: Mapping[str, Size] = {
    "medium": Size(8, 512, 8, 2048, (64, 128, 256, 512), 128, 0.1),
    # A million parameters learn far fewer frames by heart than they are shown; drawing masks is a fifth of a step.
    "mini": Size(4, 128, 4, 512, (), 128, 0.0),
}
# What is asked of the encoder: a learned query each, in this order, before all other tokens.
PATH, WAYPOINT, SPEED, QUERIES = 0, 1, 2, 3
TILE, TILE_FEATURES = 8, 32


def size_of(base: Network) -> str:
    """A name of SIZES; InputError where the facts of some weights name none."""
    size = str(base.training.get("size", ""))
    if size not in SIZES:
        raise InputError(f"weights {base.name!r}: size {size!r}, expected {' or '.join(SIZES)}")
    return size


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
    int(ActorKind.CAR): CAR,
    int(ActorKind.BUS): BUS,
    int(ActorKind.BICYCLE): BICYCLE,
    int(ActorKind.PEDESTRIAN): PEDESTRIAN,
}
_NO_LIMIT_MPS = 22.2


class Tokeniser:
    """Makes tokens in one network. The slots of objects, up to side_m (m) to the left and right, are filled from the
    nearest on.
    """

    def __init__(self, network: RoadMap, side_m: float = RANGE_M) -> None:
        self.network, self.side_m = network, side_m
        self._patches = Patches(network)

    def tokens(self, o: Observation, pose: Pose | None = None) -> Records:
        """(1,) of `tokens.TOKENS`; `pose`: as seen from there and not from where the ego is."""
        record: Records = np.zeros(1, dtype=TOKENS)
        self.fill(record[0], o, pose)
        return record

    def watch(self, o: Observation) -> None:
        """Called for every tick: there is nothing to remember."""

    def fill(self, record: Record, o: Observation, pose: Pose | None = None) -> list[int]:
        """Write the tokens into a zeroed record that has the fields of `tokens.TOKENS`.

        Returns for each filled slot the object's row in `o.actors` (-1: an obstacle).
        """
        here = (o.ego.x, o.ego.y, o.ego.heading) if pose is None else pose
        rows, origins = nearest(o, here, self.side_m)
        if rows:
            count = len(rows)
            record["kinds"][:count] = [row[0] for row in rows]
            record["objects"][:count] = [row[1:] for row in rows]
        path, s = o.route.path, o.route.s
        record["route"] = points_ahead(path.line, s, ROUTE_AHEAD_M, here) / POSITION_SCALE_M
        record["limits"] = [min(path.limit_at(s + ahead), _NO_LIMIT_MPS) / SPEED_SCALE_MPS for ahead in LIMIT_AHEAD_M]
        record["patch"] = self._patches.cut(path, *here)
        return origins


def nearest(o: Observation, pose: Pose, side_m: float) -> tuple[list[tuple[float, ...]], list[int]]:
    """Object rows (class, then features), nearest first, and for each its row in `o.actors` (-1: an obstacle)."""
    x0, y0, heading = pose
    c, s = math.cos(heading), math.sin(heading)
    found: list[tuple[float, int, int, float, float, float, float, float, float]] = []
    speeds, kinds = o.actors.speed.tolist(), o.actors.kind.tolist()
    bodies = [(k, _CLASS[kinds[k]], speeds[k], box) for k, box in enumerate(o.actors.boxes)]
    bodies += [(-1, STATIC, 0.0, (b.x, b.y, b.heading, b.length, b.width)) for b in o.obstacles]
    for k, kind, speed, (x, y, h, length, width) in bodies:
        dx, dy = x - x0, y - y0
        u, v = c * dx + s * dy, c * dy - s * dx
        if -RANGE_M <= u <= AHEAD_FACTOR * RANGE_M and abs(v) <= side_m:
            found.append((u * u + v * v, k, kind, u, v, h - heading, speed, length, width))
    found.sort()
    rows: list[tuple[float, ...]] = [
        (
            kind,
            u / POSITION_SCALE_M,
            v / POSITION_SCALE_M,
            math.cos(yaw),
            math.sin(yaw),
            speed / SPEED_SCALE_MPS,
            length / LENGTH_SCALE_M,
            width / WIDTH_SCALE_M,
        )
        for _, _, kind, u, v, yaw, speed, length, width in found[:OBJECTS]
    ]
    return rows, [entry[1] for entry in found[:OBJECTS]]


def points_ahead(line: Polyline, s: float, ahead: Sequence[float], pose: Pose) -> Array:
    """(k, 2) points of a line so far (m) ahead of arc length s, in the pose's frame."""
    return to_frame(np.array([line.point_at(s + metres) for metres in ahead]), pose)


def to_frame(points: Array, pose: Pose) -> Array:
    """(k, 2) world points in the frame of a pose."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = points[:, 0] - pose[0], points[:, 1] - pose[1]
    return np.array((c * dx + s * dy, c * dy - s * dx)).T
