"""Colours and sizes of pictures, how a page is divided, and the camera from the network's metres to its pixels.

Colours are RGB. Sizes are m on the road, px on the page. The camera is north up, of one scale, exact below a pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tsbench.geometry.polyline import Array

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
