"""Driving sides: all codes of ISO 3166 once, well-known countries on their side, and the countries' own files agree."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from command_line import one_line

from tsbench.core.errors import InputError
from tsbench.signs.countries import country_code, driving_sides, load_country


def test_every_country_has_a_side() -> None:
    sides = driving_sides()
    assert len(sides) == 249
    assert sum(side == "left" for side in sides.values()) == 77


@pytest.mark.parametrize(
    ("side", "codes"),
    [
        ("left", "gb ie mt cy in pk bd lk jp th id my sg hk mo au nz za ke tz ug zm zw mz na bw sr gy jm vi tl ws"),
        ("right", "de no se is ru cn tw kr ph vn mm la kh us ca mx br gi pr ng gh rw bi so eg af ir io ao et"),
    ],
)
def test_well_known_ones(side: str, codes: str) -> None:
    assert {code: driving_sides()[code] for code in codes.split()} == dict.fromkeys(codes.split(), side)


def test_codes_are_folded_to_small_letters() -> None:
    assert [country_code(text, "x") for text in ("GB", "gb", "No")] == ["gb", "gb", "no"]


@pytest.mark.parametrize("text", ["", "uk", "zz", "xk", "g", "gbr", "gb ", "ß", "49", "en"])
def test_what_no_country_has_is_one_line(text: str) -> None:
    with one_line(match=r"^x: .* is no country's code: write its two letters"):
        country_code(text, "x")


def test_a_country_s_file_cannot_say_otherwise(edited: Callable[[str, str, str], Path]) -> None:
    root = edited("countries/gb.yaml", "side: left", "side: right")
    with pytest.raises(InputError, match=r"gb\.yaml: traffic: side: right: driving_sides\.yaml says left"):
        load_country("gb", root)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("left: [\n  ag,", "left: [\n  de, ag,", "de: stands twice"),
        ("left: [\n  ag,", "left: [\n  Ag,", "'Ag': a code is two small letters"),
    ],
)
def test_a_wrong_table_is_one_line(edited: Callable[[str, str, str], Path], old: str, new: str, says: str) -> None:
    root = edited("driving_sides.yaml", old, new)
    with pytest.raises(InputError, match=rf"driving_sides\.yaml: .*{says}"):
        driving_sides(root)
