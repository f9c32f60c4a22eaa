"""Plates render on any machine, in their colours, with the posted value on them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_line import one_line
from lxml import etree

from tsbench.core.errors import InputError
from tsbench.signs.catalog import load_catalog
from tsbench.signs.countries import Artwork
from tsbench.signs.plates import number_path, plate_rgba, plate_svg

OWN = Artwork(load_catalog())
SIGNS = OWN.catalog.signs

# Colours that must each cover at least this share of the plate's opaque pixels.
COLOURS = {
    "red": (200, 20, 30),
    "blue": (11, 82, 160),
    "white": (255, 255, 255),
    "yellow": (253, 197, 0),
    "black": (26, 26, 26),
}
LOOKS = {
    **{code: {"red": 0.3, "white": 0.15, "black": 0.05} for code in ("2.3.1", "2.3.2", "2.3.3")},
    "2.1": {"yellow": 0.25, "white": 0.4},
    "2.4": {"red": 0.3, "white": 0.3},
    "2.5": {"red": 0.6, "white": 0.1},
    "3.1": {"red": 0.6, "white": 0.15},
    "3.2": {"red": 0.3, "white": 0.5},
    **{code: {"red": 0.3, "white": 0.3, "black": 0.03} for code in ("3.18.1", "3.18.2")},
    "3.24": {"red": 0.3, "white": 0.3, "black": 0.08},
    "3.25": {"white": 0.6},
    "5.31": {"red": 0.1, "white": 0.4, "black": 0.1},
    "5.32": {"white": 0.4},
    "5.19": {"blue": 0.4, "white": 0.2, "black": 0.08},
    "5.22": {"blue": 0.3, "white": 0.15, "red": 0.03},
}
BLUE = {"blue": 0.45, "white": 0.1}


def posted(code: str) -> float | None:
    value = SIGNS[code].value
    return None if value is None or not value.printed else value.allowed[0]


def share(pixels: np.ndarray, colour: tuple[int, int, int]) -> float:
    opaque = pixels[pixels[..., 3] > 200][:, :3].astype(int)
    return float(np.mean(np.abs(opaque - colour).max(axis=1) < 40))


@pytest.mark.parametrize("code", list(SIGNS))
@pytest.mark.parametrize("size", [48, 128])
def test_every_plate_has_its_colours(code: str, size: int) -> None:
    pixels = plate_rgba(OWN, code, posted(code), size)
    assert pixels.shape == (size, size, 4)
    assert pixels.dtype == np.uint8
    assert np.mean(pixels[..., 3] > 200) > 0.3
    for colour, least in LOOKS.get(code, BLUE).items():
        assert share(pixels, COLOURS[colour]) >= least, colour


def test_a_temporary_plate_is_the_same_on_yellow_ground() -> None:
    usual, yellow = (plate_rgba(OWN, "3.24", 40.0, 128, temporary=is_one) for is_one in (False, True))
    assert share(yellow, COLOURS["yellow"]) == pytest.approx(share(usual, COLOURS["white"]), abs=0.02)
    assert share(yellow, COLOURS["red"]) == pytest.approx(share(usual, COLOURS["red"]), abs=0.02)
    assert share(yellow, COLOURS["white"]) < 0.02
    assert np.array_equal(usual, plate_rgba(OWN, "3.24", 40.0, 128))


def test_corners_are_transparent() -> None:
    for code in SIGNS:
        assert not plate_rgba(OWN, code, posted(code), 64)[[0, 0, -1, -1], [0, -1, 0, -1], 3].any(), code


def test_every_plate_looks_different() -> None:
    pictures = {plate_rgba(OWN, code, posted(code), 48).tobytes() for code in SIGNS}
    assert len(pictures) == len(SIGNS)


@pytest.mark.parametrize("code", [code for code, sign in SIGNS.items() if sign.value and sign.value.printed])
def test_each_value_gives_another_picture(code: str) -> None:
    value = SIGNS[code].value
    assert len({plate_rgba(OWN, code, number, 48).tobytes() for number in value.allowed}) == len(value.allowed)


@pytest.mark.parametrize("code", list(SIGNS))
def test_no_plate_needs_a_font_or_another_file(code: str) -> None:
    names = {etree.QName(node).localname for node in etree.fromstring(plate_svg(OWN, code, posted(code))).iter()}
    assert names <= {"svg", "title", "g", "path", "polygon", "circle", "rect"}


def test_mirror_signs_are_mirror_pictures() -> None:
    for one, other in (("4.1.2", "4.1.3"), ("4.1.4", "4.1.5"), ("4.2.1", "4.2.2"), ("5.7.1", "5.7.2")):
        flipped = plate_rgba(OWN, other, None, 64)[:, ::-1].astype(int)
        assert np.abs(plate_rgba(OWN, one, None, 64).astype(int) - flipped).mean() < 2.0


def test_pictures_are_cached_and_cannot_be_painted_over() -> None:
    picture = plate_rgba(OWN, "2.4", None, 32)
    assert plate_rgba(OWN, "2.4", None, 32) is picture
    with pytest.raises(ValueError, match="read-only"):
        picture[0, 0, 0] = 1


def test_values_that_a_sign_cannot_carry_are_refused() -> None:
    for code, value in (("3.24", None), ("3.24", 33.0), ("2.4", 20.0)):
        with pytest.raises(ValueError, match=code):
            plate_svg(OWN, code, value)
    assert plate_svg(OWN, "5.21") == plate_svg(OWN, "5.21", 20.0)
    with pytest.raises(ValueError, match="0 px"):
        plate_rgba(OWN, "2.4", None, 0)
    with pytest.raises(InputError, match="no sign"):
        plate_svg(OWN, "9.9")


def test_numbers_keep_within_the_width_of_two_digits() -> None:
    for number in (5.0, 40.0, 110.0):
        _, width, squeeze = number_path(number)
        assert width * squeeze <= number_path(88.0)[1] + 1e-9
    for number in (-5.0, 2.5):
        with pytest.raises(ValueError, match="no plate shows"):
            number_path(number)


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("plates/3.24.svg", "</svg>", "", "2"),
        ("plates/3.24.svg", 'viewBox="0 0 200 200"', 'viewBox="0 0 9 9"', "viewBox"),
        ("plates/3.24.svg", "{value}", "60", "may be text"),
        ("plates/3.24.svg", 'font-size="110"', "", "font-size"),
        ("plates/2.4.svg", "</svg>", "<text>{value}</text></svg>", "may be text"),
    ],
)
def test_a_damaged_drawing_gives_one_line(
    edited: Callable[[str, str, str], Path], name: str, old: str, new: str, said: str
) -> None:
    root = edited(name, old, new)
    code = Path(name).stem
    with one_line(str(root / name), match=said):
        plate_svg(Artwork(load_catalog(root)), code, posted(code))
