"""Speed and acceleration of the ego over time, a strip under a film's picture. Drawn once; a line tells the moment."""

from __future__ import annotations

import cv2
import numpy as np

from tsbench.episode.trace import Trace
from tsbench.geometry.polyline import Array
from tsbench.report.drawing.camera import SHIFT, Image
from tsbench.report.drawing.style import STYLE
from tsbench.report.drawing.text import write

_PAD_PX, _TITLE_PX, _FONT = 4, 13, 10
# What an axis shows at least.
_SPEED_KMH, _ACCELERATION_MPS2 = (0.0, 20.0), (-2.0, 2.0)
_AXIS = (70, 76, 84)


class Strip:
    """Both curves, one below the other, over the same time as the time line of the footer below them."""

    def __init__(self, trace: Trace, width: int, height: int) -> None:
        """trace: of an episode; width, height: px."""
        self._image: Image = np.full((height, width, 3), STYLE.panel, dtype=np.uint8)
        time = np.array([s.time for s in trace.snapshots])
        self._last = max(float(time[-1]), 1e-9)
        half = height // 2
        panels = (
            ("speed", "km/h", 3.6 * np.array([s.ego.speed for s in trace.snapshots]), _SPEED_KMH),
            ("acceleration", "m/s²", np.array([s.ego.acceleration for s in trace.snapshots]), _ACCELERATION_MPS2),
        )  # fmt: skip
        for k, (name, unit, values, least) in enumerate(panels):
            part = self._image[k * half : (k + 1) * half]
            for event in trace.events:
                left, right = self._x(event.start_s), self._x(event.end_s)
                part[:, left : max(right, left + 2)] = (70, 36, 42)
            self._draw(part, time, values, f"{name}, {unit}", least)

    def _x(self, time: float) -> int:
        return round(min(time / self._last, 1.0) * (int(self._image.shape[1]) - 1))

    def _draw(self, part: Image, time: Array, values: Array, title: str, least: tuple[float, float]) -> None:
        low, high = min(least[0], float(values.min())), max(least[1], float(values.max()))
        top, bottom = _TITLE_PX + 1, part.shape[0] - _PAD_PX
        y = bottom - (values - low) / (high - low) * (bottom - top)
        zero = round(bottom - (0.0 - low) / (high - low) * (bottom - top))
        part[zero, :] = _AXIS
        points = np.column_stack((time / self._last * (part.shape[1] - 1), y))
        fixed = np.rint(points * (1 << SHIFT)).astype(np.int32)
        cv2.polylines(part, [fixed], False, STYLE.trail, 2, cv2.LINE_AA, SHIFT)
        write(part, _PAD_PX, 0, f"{title}, {low + 0.0:.0f} to {high:.0f}", _FONT, STYLE.faint)

    def lay(self, page: Image, top: int, time: float) -> None:
        """Copy it into a page from row `top` on, with a line at `time` (s)."""
        height, x = self._image.shape[0], self._x(time)
        page[top : top + height] = self._image
        page[top : top + height, max(x - 1, 0) : x + 1] = STYLE.ink
