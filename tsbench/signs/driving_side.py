"""The side that traffic keeps to, by country: `sign_catalog/driving_sides.yaml` has every code of ISO 3166."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

from tsbench.core.errors import InputError
from tsbench.core.paths import data_file
from tsbench.core.typed import Text, read_sheet

Side = Literal["left", "right"]
_CODE = re.compile("[a-z]{2}")


@dataclass(frozen=True)
class _File:
    table: Text
    left: tuple[Text, ...]
    right: tuple[Text, ...]


def country_code(text: str, where: str) -> str:
    """The code of a country in small letters. Raises InputError (`where`: problem) for one that no country has."""
    code = text.lower()
    if code not in driving_sides():
        raise InputError(
            f"{where}: {text!r:.80} is no country's code: write its two letters of ISO 3166, such as de, or gb for the "
            "United Kingdom"
        )
    return code


def driving_sides(root: Path | None = None) -> Mapping[str, Side]:
    """The side of each country by its code. root: the catalogue's folder; by default the data's."""
    return _read((data_file("sign_catalog") if root is None else root) / "driving_sides.yaml")


@cache
def _read(path: Path) -> Mapping[str, Side]:
    return read_sheet(_File, path, "table", _sides)


def _sides(file: _File) -> Mapping[str, Side]:
    codes = (*file.left, *file.right)
    for code in codes:
        if not _CODE.fullmatch(code):
            raise ValueError(f"{code!r:.80}: a code is two small letters")
        if codes.count(code) > 1:
            raise ValueError(f"{code}: stands twice")
    return {**dict.fromkeys(file.left, "left"), **dict.fromkeys(file.right, "right")}
