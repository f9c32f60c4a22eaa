"""Plate 8.13 as a picture."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from PIL import Image as PilImage
from resvg_py import svg_to_bytes

from tsbench.report.drawing.canvas import Image
from tsbench.sim.main_road import MainRoad

_MAIN_PX, _OTHER_PX, _REACH_PX = 30, 11, 78


def main_road_svg(key: str) -> str:
    """The plate of a name (`MainRoad.key`) as an SVG document of 200 x 200 units."""
    road = MainRoad.of(key)
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 200 200"><title>8.13 Main road\'s direction</title>'
        '<rect x="3" y="3" width="194" height="194" rx="12" fill="#ffffff" stroke="#1a1a1a" stroke-width="6"/>'
        '<g fill="none" stroke="#1a1a1a" stroke-linejoin="round">'
        f"{''.join(_way((angle,), _OTHER_PX) for angle in road.others)}{_way(road.main, _MAIN_PX)}</g></svg>"
    )


def _way(angles: Sequence[int], width: int) -> str:
    """A road through the middle (two angles), or to it (one)."""
    ends = [(100 - _REACH_PX * math.sin(math.radians(a)), 100 - _REACH_PX * math.cos(math.radians(a))) for a in angles]
    points = [ends[0], (100.0, 100.0), *ends[1:]]
    return f'<polyline stroke-width="{width}" points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in points)}"/>'


@lru_cache(maxsize=256)
def main_road_rgba(key: str, size_px: int) -> Image:
    """The plate of a name, read-only (size_px, size_px, 4), RGB with straight alpha."""
    png = svg_to_bytes(svg_string=main_road_svg(key), width=size_px, height=size_px, skip_system_fonts=True)
    with PilImage.open(io.BytesIO(png)) as picture:
        pixels = np.array(picture.convert("RGBA"))
    pixels.setflags(write=False)
    return pixels
