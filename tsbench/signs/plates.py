"""Plates as pictures: SVG with the posted value drawn in, RGBA arrays, and all of them on one sheet by group."""

from __future__ import annotations

import io
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
from lxml import etree
from PIL import Image, ImageDraw, ImageFont
from resvg_py import svg_to_bytes

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, replacing
from tsbench.signs.catalog import Catalog
from tsbench.signs.countries import Artwork
from tsbench.signs.model import GROUPS, Sign

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
_WHITE, _YELLOW = "#ffffff", "#fdc500"
_CACHED_PICTURES = 512


def plate_svg(artwork: Artwork, code: str, value: float | None = None, *, temporary: bool = False) -> str:
    """The plate as an SVG document of 200 x 200 units without any text element.

    value: required where the sign prints one. temporary: its white ground is yellow. Raises InputError for an unknown
    code or a drawing that does not parse, ValueError for a value that the sign cannot carry.
    """
    return _svg(*artwork.drawing(code, value), temporary=temporary)


def plate_rgba(
    artwork: Artwork, code: str, value: float | None, size_px: int, *, temporary: bool = False
) -> npt.NDArray[np.uint8]:
    """The plate as a read-only (size_px, size_px, 4) array of RGB with straight alpha, 0 around the plate.

    Raises as `plate_svg` does, and ValueError for a size below 1 px.
    """
    if size_px < 1:
        raise ValueError(f"a picture of {size_px} px")
    return _rgba(*artwork.drawing(code, value), size_px=size_px, temporary=temporary)


def _svg(path: Path, number: float | None, *, temporary: bool) -> str:
    root = etree.fromstring(_drawing(path))
    for ground in root.iterfind(f".//*[@fill='{_WHITE}']") if temporary else ():
        ground.set("fill", _YELLOW)
    for text in list(root.iter(f"{_SVG}text")):
        if text.text != "{value}" or number is None:
            raise InputError(f"{path}: text {text.text!r}: only {{value}} of a sign that posts one may be text")
        parent = text.getparent()
        assert parent is not None
        parent.replace(text, _number(text, number, path))
    return etree.tostring(root, encoding="unicode")


@lru_cache(maxsize=_CACHED_PICTURES)
def _rgba(path: Path, number: float | None, *, size_px: int, temporary: bool) -> npt.NDArray[np.uint8]:
    svg = _svg(path, number, temporary=temporary)
    png = svg_to_bytes(svg_string=svg, width=size_px, height=size_px, skip_system_fonts=True)
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


_COLUMNS = 8
_PLATE_PX = 120
_CELL_W, _CELL_H = 172, 212
_MARGIN = 28
_TITLE_H = 44
_INK, _DIM, _PAPER, _RULE = "#1a1a1a", "#5f6368", "#f4f5f2", "#c9ccc6"


def draw_sheet(artwork: Artwork) -> Image.Image:
    """The contact sheet: a band per group, in it the signs by scenario type with plate, code and name."""
    catalog = artwork.catalog
    bands = [(group, _signs_of(catalog, group)) for group in GROUPS]
    heights = [_TITLE_H + _CELL_H * -(-len(signs) // _COLUMNS) for _, signs in bands]
    size = (2 * _MARGIN + _COLUMNS * _CELL_W, 2 * _MARGIN + sum(heights))
    sheet = Image.new("RGBA", size, _PAPER)
    top = _MARGIN
    for (group, signs), height in zip(bands, heights, strict=True):
        types = sum(kind.group == group for kind in catalog.types)
        _title(sheet, top, f"{group.capitalize()} · {types} scenario types")
        for place, sign in enumerate(signs):
            row, column = divmod(place, _COLUMNS)
            _cell(sheet, _MARGIN + column * _CELL_W, top + _TITLE_H + row * _CELL_H, sign, artwork)
        top += height
    return sheet.convert("RGB")


def save_sheet(artwork: Artwork, path: Path) -> None:
    """Draw the contact sheet into a PNG file. Raises InputError for another suffix and where it cannot be written."""
    if path.suffix.lower() != ".png":
        raise InputError(f"{path}: the sheet is a PNG, name it so")
    with io_errors_as_input_errors(path), replacing(path) as part:
        draw_sheet(artwork).save(part, format="PNG")


def _signs_of(catalog: Catalog, group: str) -> list[Sign]:
    return [
        catalog.sign(code) for kind in catalog.types if kind.group == group for code in (*kind.codes, *kind.end_codes)
    ]


def _title(sheet: Image.Image, top: int, text: str) -> None:
    draw = ImageDraw.Draw(sheet)
    draw.text((_MARGIN, top + 4), text, fill=_INK, font=ImageFont.load_default(22))
    draw.line((_MARGIN, top + 36, sheet.width - _MARGIN, top + 36), fill=_RULE, width=2)


def _cell(sheet: Image.Image, left: int, top: int, sign: Sign, artwork: Artwork) -> None:
    value = None
    if sign.value is not None and sign.value.printed:
        value = sign.value.allowed[len(sign.value.allowed) // 2]
    plate = Image.fromarray(plate_rgba(artwork, sign.code, value, _PLATE_PX))
    sheet.alpha_composite(plate, (left + (_CELL_W - _PLATE_PX) // 2, top + 8))
    draw = ImageDraw.Draw(sheet)
    middle = left + _CELL_W // 2
    code = artwork.code(sign.code)
    draw.text((middle, top + _PLATE_PX + 14), code, fill=_INK, font=_fitting(code, _CELL_W - 8), anchor="ma")
    font = ImageFont.load_default(14)
    for number, text in enumerate(_wrap(sign.name_en, font, _CELL_W - 12)):
        draw.text((middle, top + _PLATE_PX + 37 + 17 * number), text, fill=_DIM, font=font, anchor="ma")


def _fitting(code: str, width: float) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """The largest of the codes' sizes in which a code fits; those of several signs are long."""
    fonts = [ImageFont.load_default(size) for size in (17, 15, 13)]
    return next((font for font in fonts if font.getlength(code) <= width), fonts[-1])


def _wrap(text: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont, width: float) -> list[str]:
    """Break a text between words into lines that fit."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if font.getlength(longer) <= width or not lines[-1]:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines
