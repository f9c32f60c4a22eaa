"""A small vector font for the numbers on plates, so that they look the same on a machine without fonts.

Each glyph is a stroked path on a grid 60 wide and 100 high (y down, baseline at 100), drawn for this project.
"""

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
        f'<path d="{DIGITS[digit]}" transform="translate({place * ADVANCE:g} 0)"/>'
        for place, digit in enumerate(text)
    )
    return glyphs, width, min(1.0, _WIDEST / width)
