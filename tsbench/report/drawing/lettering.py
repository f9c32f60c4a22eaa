"""Text in pictures: DejaVu Sans (it comes with matplotlib), each piece rendered once, then blended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np
from PIL import Image as PilImage
from PIL import ImageDraw, ImageFont

from tsbench.report.drawing.canvas import Colour, Image


@cache
def _font(size: int, bold: bool) -> ImageFont.FreeTypeFont:
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(mpl.get_data_path()) / "fonts" / "ttf" / name), size)


@lru_cache(maxsize=4096)
def _mask(text: str, size: int, bold: bool) -> Image:
    font = _font(size, bold)
    ascent, descent = font.getmetrics()
    picture = PilImage.new("L", (max(int(np.ceil(font.getlength(text))), 1), ascent + descent), 0)
    ImageDraw.Draw(picture).text((0, 0), text, fill=255, font=font)
    return np.array(picture)


@lru_cache(maxsize=4096)
def text_width(text: str, size: int, bold: bool = False) -> int:
    return int(np.ceil(_font(size, bold).getlength(text)))


def line_height(size: int) -> int:
    ascent, descent = _font(size, False).getmetrics()
    return ascent + descent


def write(image: Image, x: int, y: int, text: str, size: int, colour: Colour, bold: bool = False) -> int:
    """Write a line with its upper left corner at (x, y), clipped at the image; returns the x behind it."""
    mask = _mask(text, size, bold)
    blend(image, x, y, mask, colour)
    return x + int(mask.shape[1])


@lru_cache(maxsize=512)
def tile(text: str, size: int, colour: Colour, ground: Colour, bold: bool = False) -> Image:
    """A piece of text on a ground of one colour, (h, w, 3): to be copied into frames without blending."""
    mask = _mask(text, size, bold)
    image = np.empty((*mask.shape, 3), dtype=np.uint8)
    image[:] = ground
    blend(image, 0, 0, mask, colour)
    return image


def stamp(image: Image, x: int, y: int, picture: Image) -> int:
    """Copy an opaque picture (h, w, 3) that lies within the image; returns the x behind it."""
    height, width = picture.shape[:2]
    image[y : y + height, x : x + width] = picture
    return int(x + width)


@dataclass(frozen=True)
class Label:
    """Text with a halo, legible on any ground. (h, w, 3) each: share, what it adds; rest, what it lets through."""

    share: Image
    rest: Image

    def lay(self, image: Image, x: int, y: int) -> None:
        """Lay it over the image, wholly within it; at every frame, so by OpenCV's few passes."""
        height, width = self.share.shape[:2]
        below = image[y : y + height, x : x + width]
        cv2.multiply(below, self.rest, dst=below, scale=1 / 255)
        cv2.add(below, self.share, dst=below)


@cache
def label(text: str, size: int, colour: Colour, halo: Colour) -> Label:
    inner = np.pad(_mask(text, size, False), 1)
    outer = np.max([np.roll(inner, step, axis) for step in (-1, 1) for axis in (0, 1)], axis=0)
    share = np.empty((*inner.shape, 3), dtype=np.uint8)
    share[:] = halo
    blend(share, 0, 0, inner, colour)
    alpha = np.repeat(np.maximum(outer, inner)[..., None], 3, axis=2)
    return Label(cv2.multiply(share, alpha, scale=1 / 255), 255 - alpha)


def blend(image: Image, x: int, y: int, mask: Image, colour: Colour) -> None:
    """Lay a colour over the image through a mask (h, w), clipped at the image's edges."""
    paste(image, x, y, np.broadcast_to(np.array(colour, dtype=np.uint8), (*mask.shape, 3)), mask)


def paste(image: Image, x: int, y: int, picture: Image, alpha: Image) -> None:
    """Lay a picture (h, w, 3) with alpha (h, w) over the image, clipped at its edges."""
    height, width = alpha.shape
    x0, y0 = max(x, 0), max(y, 0)
    x1, y1 = min(x + width, image.shape[1]), min(y + height, image.shape[0])
    if x0 >= x1 or y0 >= y1:
        return
    a = alpha[y0 - y : y1 - y, x0 - x : x1 - x, None].astype(np.uint16)
    top = picture[y0 - y : y1 - y, x0 - x : x1 - x].astype(np.uint16)
    below = image[y0:y1, x0:x1]
    below[:] = (top * a + below * (255 - a) + 127) // 255


def wrap(text: str, size: int, width: int, lines: int) -> list[str]:
    """Break a text into at most `lines` lines of `width` px; what does not fit ends in an ellipsis."""
    out: list[str] = []
    line = ""
    for word in text.split():
        longer = f"{line} {word}".strip()
        if line and text_width(longer, size) > width:
            out.append(line)
            line = word
        else:
            line = longer
    out.append(line)
    if len(out) > lines:
        out = [*out[: lines - 1], out[lines - 1] + " …"]
    return [shorten(row, size, width) for row in out]


def fitted(text: str, sizes: Sequence[int], width: int, bold: bool = False) -> tuple[str, int]:
    """The text and the first of the sizes in which it fits into `width` px; if none, cut in the last one."""
    for size in sizes:
        if text_width(text, size, bold) <= width:
            return text, size
    return shorten(text, sizes[-1], width, bold), sizes[-1]


def shorten(text: str, size: int, width: int, bold: bool = False) -> str:
    """The text, or as much of it as fits into `width` px with an ellipsis."""
    if text_width(text, size, bold) <= width:
        return text
    while text and text_width(text + "…", size, bold) > width:
        text = text[:-1]
    return text + "…"
