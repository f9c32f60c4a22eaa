"""The taxonomy on one page: every plate with code and name, by group."""

from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, replacing
from tsbench.signs.catalog import Catalog
from tsbench.signs.countries import Artwork
from tsbench.signs.model import GROUPS, Sign
from tsbench.signs.plates import plate_rgba

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
