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
from tsbench.signs.catalog import load_catalog
from tsbench.signs.countries import Country, country_in_use
from tsbench.signs.digits import GLYPH_HEIGHT, STROKE, number_path

_SVG = "{http://www.w3.org/2000/svg}"
_CAP_HEIGHT = 0.73  # height of a digit as a share of the font size, as in common sans-serif fonts
_CACHED_PICTURES = 512


def plate_svg(code: str, value: float | None = None) -> str:
    """The plate as an SVG document of 200 x 200 units without any text element.

    value: required where the sign prints one. The plate is that of the city in use, where its country has a file, else
    the catalogue's. Raises InputError for an unknown code or a drawing that does not parse, ValueError for a value
    that the sign cannot carry.
    """
    return _svg(*_shown(code, value, None))


def plate_rgba(
    code: str, value: float | None, size_px: int, country: Country | None = None
) -> npt.NDArray[np.uint8]:
    """The plate as a read-only (size_px, size_px, 4) array of RGB with straight alpha, 0 around the plate.

    country: whose plate it is; None: as `plate_svg` has it.
    Raises as `plate_svg` does, and ValueError for a size below 1 px.
    """
    if size_px < 1:
        raise ValueError(f"a picture of {size_px} px")
    return _rgba(*_shown(code, value, country), size_px)


def _shown(code: str, value: float | None, country: Country | None) -> tuple[Path, float | None]:
    """Of a plate: the file with its drawing, and the number that is printed on it."""
    catalog = load_catalog()
    sign, plates = catalog.sign(code), catalog.root / "plates"
    number = sign.effective_value(value)
    whose = country or country_in_use()
    if whose is None:
        return plates / sign.drawing, number
    return plates / whose.drawing(sign, plates), None if number is None else whose.posted(number)


def _svg(path: Path, number: float | None) -> str:
    root = etree.fromstring(_drawing(path))
    for text in list(root.iter(f"{_SVG}text")):
        if text.text != "{value}" or number is None:
            raise InputError(
                f"{path}: text {text.text!r}: only {{value}} of a sign that posts one may be text"
            )
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
