"""Pictures as PNG files: one, or several on a sheet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image as PilImage

from tsbench.report.drawing.camera import Image
from tsbench.report.drawing.style import STYLE
from tsbench.report.drawing.text import line_height, shorten, write
from tsbench.report.video.outfile import whole_file

_GAP_PX, _LETTER_PX = 8, 11


def sheet(panels: Sequence[tuple[str, Image]], columns: int) -> Image:
    """Pictures of one size in rows, each below its lines of text."""
    height, width, _ = panels[0][1].shape
    lines = max(len(text.split("\n")) for text, _ in panels)
    head = lines * line_height(_LETTER_PX) + _GAP_PX
    columns = min(columns, len(panels))
    rows = -(-len(panels) // columns)
    size = (rows * (head + height + _GAP_PX), columns * (width + _GAP_PX) + _GAP_PX, 3)
    page = np.full(size, STYLE.panel, dtype=np.uint8)
    for k, (text, picture) in enumerate(panels):
        top = k // columns * (head + height + _GAP_PX)
        left = _GAP_PX + k % columns * (width + _GAP_PX)
        for number, line in enumerate(text.split("\n")):
            y = top + _GAP_PX // 2 + number * line_height(_LETTER_PX)
            write(page, left, y, shorten(line, _LETTER_PX, width), _LETTER_PX, STYLE.ink)
        page[top + head : top + head + height, left : left + width] = picture
    return page


def save_png(path: Path, picture: Image) -> None:
    """Write a picture, (height, width, 3) RGB, whole or not at all. Raises InputError."""
    with whole_file(path) as part:
        PilImage.fromarray(picture).save(part, format="PNG", compress_level=4)
