"""From the network's metres to pixels: north up, one scale, subpixel exact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tsbench.geometry.polyline import Array

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
        return Camera(
            self.left + left_px / self.scale, self.top - top_px / self.scale, self.scale, width, height
        )


def camera_over(
    points: Array, width: int, height: int, margin_m: float, scale: tuple[float, float]
) -> Camera:
    """A camera of a given size that shows all points (n, 2), with a scale within bounds, centred on them."""
    low, high = points.min(axis=0) - margin_m, points.max(axis=0) + margin_m
    fit = min(width / max(high[0] - low[0], 1e-6), height / max(high[1] - low[1], 1e-6))
    px_per_m = float(min(max(fit, scale[0]), scale[1]))
    middle = (low + high) / 2
    return camera_at(float(middle[0]), float(middle[1]), px_per_m, width, height)


def camera_at(x: float, y: float, scale: float, width: int, height: int) -> Camera:
    return Camera(x - width / 2 / scale, y + height / 2 / scale, scale, width, height)
