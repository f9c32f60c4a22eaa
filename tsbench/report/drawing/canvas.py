"""Colours and sizes of pictures, how a page is divided, the camera, and the shapes that every painter draws.

Colours are RGB. Sizes are m on the road, px on the page. Shapes and the curves of roads: m, rad, in
the network's frame. The camera is north up, of one scale, exact below a pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import shapely

from tsbench.geometry.polyline import Array, Polyline
from tsbench.signs.countries import Artwork

Colour = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class Style:
    ground: Colour = (229, 232, 223)
    green: Colour = (214, 226, 203)
    water: Colour = (204, 218, 230)
    building: Colour = (215, 213, 206)
    walk: Colour = (206, 205, 199)
    asphalt: Colour = (86, 91, 99)
    kerb: Colour = (150, 154, 160)
    reserved: Colour = (104, 96, 84)
    marking: Colour = (246, 246, 242)
    ego: Colour = (255, 112, 32)
    trail: Colour = (255, 168, 96)
    car: Colour = (160, 200, 235)
    bus: Colour = (245, 200, 80)
    bicycle: Colour = (120, 214, 140)
    pedestrian: Colour = (250, 110, 170)
    convoy: Colour = (203, 160, 250)
    glass: Colour = (38, 44, 54)
    outline: Colour = (30, 33, 38)
    route: Colour = (70, 170, 255)
    plan: Colour = (214, 92, 214)
    compliant: Colour = (60, 200, 120)
    destination: Colour = (46, 178, 98)
    plate_line: Colour = (255, 196, 0)
    violation: Colour = (228, 30, 45)
    cone: Colour = (255, 120, 20)
    lamp: Colour = (255, 190, 40)
    brake: Colour = (255, 40, 40)
    island: Colour = (214, 212, 200)
    panel: Colour = (28, 32, 38)
    ink: Colour = (240, 242, 245)
    faint: Colour = (150, 158, 168)
    marking_m: float = 0.15
    stop_line_m: float = 0.4
    dash_m: tuple[float, float] = (3.0, 4.5)
    header_px: int = 64
    footer_px: int = 56
    compact_footer_px: int = 72


STYLE = Style()
VIOLATION_SHADE = 0.62  # of the violation's colour behind white text
ATTRIBUTION = "© OpenStreetMap contributors"


_COMPACT_PX = 720


@dataclass(frozen=True, slots=True)
class PageSize:
    """A picture in px, header, strip and footer included. Video encoders want even numbers.

    strip_px: height of the curves of speed and acceleration under the view; 0 = none.
    """

    width: int
    height: int
    strip_px: int = 0

    @property
    def compact(self) -> bool:
        """Is it so narrow that clock and figures need lines of their own?"""
        return self.width < _COMPACT_PX

    @property
    def header_px(self) -> int:
        return STYLE.header_px

    @property
    def footer_px(self) -> int:
        return STYLE.compact_footer_px if self.compact else STYLE.footer_px

    @property
    def view_height(self) -> int:
        return self.height - self.header_px - self.strip_px - self.footer_px


SHIFT = 4
_UNIT = 1 << SHIFT

Image = npt.NDArray[np.uint8]
Fixed = npt.NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class Camera:
    """A window on the world. left, top: its upper left corner in the world, m; scale: px per m."""

    left: float
    top: float
    scale: float
    width: int
    height: int

    def px(self, points: npt.ArrayLike) -> Array:
        """(n, 2) world points as pixel coordinates; whole numbers are the middles of pixels."""
        xy = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        out = np.empty_like(xy)
        out[:, 0] = (xy[:, 0] - self.left) * self.scale - 0.5
        out[:, 1] = (self.top - xy[:, 1]) * self.scale - 0.5
        return out

    def fixed(self, points: npt.ArrayLike) -> Fixed:
        """The same as OpenCV takes them, in 1/16 px."""
        return np.rint(self.px(points) * _UNIT).astype(np.int32)

    def thickness(self, metres: float) -> int:
        return max(round(metres * self.scale), 1)

    def window(self, left_px: int, top_px: int, width: int, height: int) -> Camera:
        return Camera(self.left + left_px / self.scale, self.top - top_px / self.scale, self.scale, width, height)


def camera_over(points: Array, width: int, height: int, margin_m: float, scale: tuple[float, float]) -> Camera:
    """A camera of a given size that shows all points (n, 2), with a scale within bounds, centred on them."""
    low, high = points.min(axis=0) - margin_m, points.max(axis=0) + margin_m
    fit = min(width / max(high[0] - low[0], 1e-6), height / max(high[1] - low[1], 1e-6))
    px_per_m = float(min(max(fit, scale[0]), scale[1]))
    middle = (low + high) / 2
    return camera_at(float(middle[0]), float(middle[1]), px_per_m, width, height)


def camera_at(x: float, y: float, scale: float, width: int, height: int) -> Camera:
    return Camera(x - width / 2 / scale, y + height / 2 / scale, scale, width, height)


@dataclass(frozen=True, slots=True)
class Area:
    """A filled surface. colour: a field of `Style`, which names what it is; polygon: any number of them, with holes."""

    colour: str
    polygon: shapely.Geometry
    opacity: float = 1.0


@dataclass(frozen=True, slots=True)
class Line:
    """An open line: (n, 2) points; width in m."""

    colour: str
    points: Array
    width: float


@dataclass(frozen=True, slots=True)
class Body:
    """Something that stands or drives: its centre, heading and size.

    kind: car, bus, bicycle, pedestrian, convoy, ego, cones or island, each of the first six a field of `Style`.
    signals: 1 = its left side flashes, -1 = its right side. brakes: do its brake lights shine?
    """

    kind: str
    name: str
    x: float
    y: float
    heading: float
    length: float
    width: float
    signals: int = 0
    brakes: bool = False


@dataclass(frozen=True, slots=True)
class DrawnPlate:
    """A traffic sign at its post. heading: of the traffic that it faces.

    away: unit vector in the picture (rows grow downwards) that leads off the road; clear: distance to the kerb.
    artwork: how it looks. below: name of the main road's shape beneath it (`MainRoad.key`), "" = none.
    temporary: on yellow ground.
    """

    name: str
    role: str
    code: str
    value: float | None
    x: float
    y: float
    heading: float
    away: Array
    clear: float
    target: bool
    artwork: Artwork
    below: str = ""
    temporary: bool = False


Shape = Area | Line | Body | DrawnPlate


def dashes(points: Array, dash: float, gap: float) -> list[Array]:
    """Pieces of a line (n, 2), each (m, 2)."""
    line = Polyline(points)
    starts = np.arange(0.0, max(line.length - dash / 2, 0.01), dash + gap)
    return [line.slice(s, min(s + dash, line.length)).points for s in starts.tolist() if s + 0.01 < line.length]


def cone_places(cones: Body) -> Array:
    """(n, 2): where the cones of a row stand."""
    along = np.linspace(-0.5, 0.5, max(round(cones.length / 1.5), 2)) * (cones.length - 0.4)
    return np.column_stack((cones.x + along * np.cos(cones.heading), cones.y + along * np.sin(cones.heading)))


# A corner is cut so far before and behind it at most, and by no more than half of the shorter piece. The curve then is
# a third of that from the corner where it turns by a right angle.
_CUT_M = 8.0
_LEAST_TURN_RAD, _MOST_TURN_RAD = math.radians(2.0), math.radians(100.0)
_STEP_RAD = math.radians(6.0)
_LINES = 4096


@lru_cache(maxsize=_LINES)
def _rounded(raw: bytes) -> tuple[Array, Array]:
    """The curve's points, and of each the arc length along the line itself."""
    points = np.frombuffer(raw).reshape(-1, 2)
    made, along = [points[0]], [0.0]
    steps = np.diff(points, axis=0)
    lengths = np.hypot(*steps.T)
    ends = np.cumsum(lengths)
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    turns = (np.diff(headings) + math.pi) % (2.0 * math.pi) - math.pi
    for k, turn in enumerate(turns.tolist()):
        corner, cut = points[k + 1], min(_CUT_M, 0.5 * float(min(lengths[k], lengths[k + 1])))
        if not _LEAST_TURN_RAD < abs(turn) < _MOST_TURN_RAD or cut < 0.05:
            made.append(corner)
            along.append(float(ends[k]))
            continue
        before, behind = corner - cut * steps[k] / lengths[k], corner + cut * steps[k + 1] / lengths[k + 1]
        t = np.linspace(0.0, 1.0, 2 + math.ceil(abs(turn) / _STEP_RAD))[:, None]
        made += list((1.0 - t) ** 2 * before + 2.0 * t * (1.0 - t) * corner + t**2 * behind)
        along += (ends[k] + cut * (2.0 * t[:, 0] - 1.0)).tolist()
    made.append(points[-1])
    along.append(float(ends[-1]))
    return np.array(made), np.array(along)


def rounded(line: Polyline) -> Polyline:
    """A line whose corners are curves; it begins and ends where the line does."""
    return Polyline(_curve(line)[0]) if len(line.points) > 2 else line


def rounded_along(line: Polyline, step: float) -> tuple[Array, Array]:
    """Places each `step` m along a line, and where its rounded form is there: (n,) arc lengths of the line, (n, 2)."""
    points, s = _curve(line)
    places = np.append(np.arange(0.0, line.length, step), line.length)
    return places, np.column_stack([np.interp(places, s, points[:, k]) for k in (0, 1)])


def _curve(line: Polyline) -> tuple[Array, Array]:
    return _rounded(np.ascontiguousarray(line.points, dtype=np.float64).tobytes())


def lane_area(line: Polyline, width: float) -> shapely.Polygon:
    """What a lane of this width covers, with flat ends and round bends."""
    return shapely.LineString(rounded(line).points).buffer(width / 2, cap_style="flat", join_style="round")
