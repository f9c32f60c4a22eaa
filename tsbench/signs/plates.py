"""Plates as pictures: SVG with the posted value drawn in, and RGBA arrays."""

import io
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
from lxml import etree
from PIL import Image
from resvg_py import svg_to_bytes

from tsbench.core.errors import InputError
from tsbench.signs.countries import Artwork

# A small vector font for the numbers on plates, so that they look the same on a machine without fonts. Each glyph is a
# stroked path on a grid 60 wide and 100 high (y down, baseline at 100), drawn for this project.
STROKE = 18.0
GLYPH_WIDTH = 60.0
GLYPH_HEIGHT = 100.0
ADVANCE = 76.0

_WIDEST = 2 * ADVANCE - (ADVANCE - GLYPH_WIDTH)

DIGITS = {
    "0": "M51.5 32 V68 A21.5 23.5 0 0 1 8.5 68 V32 A21.5 23.5 0 0 1 51.5 32 Z",
    "1": "M12 30 L34 10 V100",
    "2": "M8.5 31 A21.5 22.5 0 0 1 51.5 31 C51.5 54 10 64 10 91.5 H55",
    "3": "M9 25 C14 2 51 4 50 28 C49 44 38 48 24 48 C40 48 52 54 52 70 C52 98 12 98 7.5 73",
    "4": "M43 100 V8.5 H41 L8.5 68 V74 H60",
    "5": "M51 8.5 H15 L12 47 C24 36 51.5 40 51.5 66 C51.5 98 12 99 8 75",
    "6": "M48 22 C42 2 8.5 4 8.5 44 V64 C8.5 101 51.5 101 51.5 65 C51.5 36 15 36 9 60",
    "7": "M4 8.5 H52 V10 L24 100",
    "8": "M30 47 C4 46 4 8.5 30 8.5 C56 8.5 56 46 30 47 C0 48 0 91.5 30 91.5 C60 91.5 60 48 30 47 Z",
    "9": "M12 78 C18 98 51.5 96 51.5 56 V36 C51.5 -1 8.5 -1 8.5 35 C8.5 64 45 64 51 40",
}


def number_path(number: float) -> tuple[str, float, float]:
    """A whole number as stroked glyphs: SVG elements without colour, their width on the grid, and the horizontal scale
    that keeps them within the width of two digits. Raises ValueError for a number that is negative or not whole.
    """
    if number < 0 or number != int(number):
        raise ValueError(f"no plate shows {number}")
    text = str(int(number))
    width = len(text) * ADVANCE - (ADVANCE - GLYPH_WIDTH)
    glyphs = "".join(
        f'<path d="{DIGITS[digit]}" transform="translate({place * ADVANCE:g} 0)"/>' for place, digit in enumerate(text)
    )
    return glyphs, width, min(1.0, _WIDEST / width)


_SVG = "{http://www.w3.org/2000/svg}"
_CAP_HEIGHT = 0.73  # height of a digit as a share of the font size, as in common sans-serif fonts
_CACHED_PICTURES = 512


def plate_svg(artwork: Artwork, code: str, value: float | None = None) -> str:
    """The plate as an SVG document of 200 x 200 units without any text element.

    value: required where the sign prints one. Raises InputError for an unknown code or a drawing that does not parse,
    ValueError for a value that the sign cannot carry.
    """
    return _svg(*artwork.drawing(code, value))


def plate_rgba(artwork: Artwork, code: str, value: float | None, size_px: int) -> npt.NDArray[np.uint8]:
    """The plate as a read-only (size_px, size_px, 4) array of RGB with straight alpha, 0 around the plate.

    Raises as `plate_svg` does, and ValueError for a size below 1 px.
    """
    if size_px < 1:
        raise ValueError(f"a picture of {size_px} px")
    return _rgba(*artwork.drawing(code, value), size_px)


def _svg(path: Path, number: float | None) -> str:
    root = etree.fromstring(_drawing(path))
    for text in list(root.iter(f"{_SVG}text")):
        if text.text != "{value}" or number is None:
            raise InputError(f"{path}: text {text.text!r}: only {{value}} of a sign that posts one may be text")
        parent = text.getparent()
        assert parent is not None
        parent.replace(text, _number(text, number, path))
    return etree.tostring(root, encoding="unicode")


@lru_cache(maxsize=_CACHED_PICTURES)
def _rgba(path: Path, number: float | None, size_px: int) -> npt.NDArray[np.uint8]:
    png = svg_to_bytes(svg_string=_svg(path, number), width=size_px, height=size_px, skip_system_fonts=True)
    with Image.open(io.BytesIO(png)) as picture:
        pixels = np.array(picture.convert("RGBA"))
    pixels.setflags(write=False)
    return pixels


@cache
def _drawing(path: Path) -> bytes:
    """The drawing's text, once it is known to be SVG."""
    parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True)
    try:
        content = path.read_bytes()
        root = etree.fromstring(content, parser)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error
    except etree.XMLSyntaxError as error:
        raise InputError(f"{path}: {error.msg}") from error
    if root.tag != f"{_SVG}svg" or root.get("viewBox") != "0 0 200 200":
        raise InputError(f"{path}: the drawing must be an svg element with viewBox 0 0 200 200")
    return etree.tostring(root)


def _number(text: etree._Element, number: float, path: Path) -> etree._Element:
    """The glyphs that take the place of a `{value}` text: same middle, baseline, size and colour."""
    try:
        x, y, size = (float(text.attrib[key]) for key in ("x", "y", "font-size"))
    except (KeyError, ValueError) as error:
        raise InputError(f"{path}: {{value}} needs numbers x, y and font-size") from error
    glyphs, width, squeeze = number_path(number)
    scale = size * _CAP_HEIGHT / GLYPH_HEIGHT
    left = x - width * squeeze * scale / 2
    group = etree.fromstring(f'<g xmlns="{_SVG[1:-1]}">{glyphs}</g>')
    top = y - size * _CAP_HEIGHT
    group.set("transform", f"translate({left:g} {top:g}) scale({scale * squeeze:g} {scale:g})")
    group.set("fill", "none")
    group.set("stroke", text.get("fill", "#000000"))
    group.set("stroke-width", f"{STROKE:g}")
    return group
