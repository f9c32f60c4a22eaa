"""Another country's plates and traffic: `sign_catalog/countries/<country>.yaml`; a sign without an entry is unknown.

The files are for readers and pictures: no rule, scene or record looks at them, and the catalogue's fingerprint leaves
them out. Scenes of a city are drawn with the plates of its country, where that has a file.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Literal, get_args

from msgspec import Meta

from tsbench.core import textfile
from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.core.paths import data_file
from tsbench.core.text import csv_text
from tsbench.core.typed import Text, read_sheet
from tsbench.signs.catalog import Catalog, load_catalog, yaml_files

Side = Literal["left", "right"]
_CODE = re.compile("[a-z]{2}")


@dataclass(frozen=True)
class _SidesFile:
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
    return read_sheet(_SidesFile, path, "table", _sides)


def _sides(file: _SidesFile) -> Mapping[str, Side]:
    codes = (*file.left, *file.right)
    for code in codes:
        if not _CODE.fullmatch(code):
            raise ValueError(f"{code!r:.80}: a code is two small letters")
        if codes.count(code) > 1:
            raise ValueError(f"{code}: stands twice")
    return {**dict.fromkeys(file.left, "left"), **dict.fromkeys(file.right, "right")}


_NONE, _UNKNOWN = "none", "unknown"
_KM_PER_MILE = 1.609344
# Classes of roads, as OpenStreetMap has them after `highway=`, and speeds that a country may give one.
RoadClass = Literal[
    "living_street", "residential", "unclassified", "tertiary", "secondary", "primary", "trunk", "motorway"
]
ROAD_CLASSES: tuple[str, ...] = get_args(RoadClass)
_Percent = Annotated[float, Meta(ge=0.0, le=100.0)]
_Speed = Annotated[float, Meta(gt=0.0, le=150.0)]
_COLUMNS = ("country", "sign", "name", "equivalent", "reason", "note", "checked")


@dataclass(frozen=True)
class Equivalent:
    """One country's sign for one sign of the catalogue.

    code: the country's official one, or several that stand together ("220-20 + 1000-33"), "none", or "unknown" where
    its file has no entry. reason: why none exists. note: what differs. checked: found in a source other than
    memory. drawing: its SVG under `sign_catalog/plates/`, None = it looks as the catalogue's sign does.
    """

    code: Text
    checked: bool
    reason: Text | None = None
    note: Text | None = None
    drawing: Text | None = None

    def __post_init__(self) -> None:
        if (self.code == _NONE) != (self.reason is not None):
            missing = self.reason is None
            raise ValueError(
                "reason: is missing" if missing else "reason: goes with code: none only; what differs is a note"
            )
        if self.code == _NONE and self.drawing is not None:
            raise ValueError("drawing: there is no such sign, so nothing to draw")

    @property
    def exists(self) -> bool:
        """Is there such a sign, as far as is known?"""
        return self.code not in (_NONE, _UNKNOWN)


@dataclass(frozen=True)
class Traffic:
    """What holds in a country where no plate says otherwise.

    side: that traffic keeps to. unit: of speeds, on plates too. unsigned: right of way at a junction without signs.
    speeds: limits in that unit by ROAD_CLASSES; one that is left out is not known, or there are no such roads.
    """

    side: Literal["left", "right"]
    unit: Literal["km/h", "mph"]
    unsigned: Literal["right_before_left", "left_before_right", "nobody"]
    speeds: Mapping[RoadClass, _Speed]

    @property
    def speeds_mps(self) -> Mapping[str, float]:
        """`speeds` in m/s, to the cm as type maps have them."""
        unit = _KM_PER_MILE if self.unit == "mph" else 1.0
        return {road: round(speed * unit / 3.6, 2) for road, speed in self.speeds.items()}


@dataclass(frozen=True)
class Country:
    """A country's signs and traffic.

    code: two small letters, also the file's name. numbering: the law or catalogue that numbers its signs.
    published_percent: share of signs with an equivalent that the spec quotes, 0-100; None where it names none. latin:
    how letters of its codes are written in a picture, whose fonts have Latin letters only. equivalents: by the
    catalogue's codes, in its order; covers all of them. traffic: None where its file does not say.
    """

    code: str
    name_en: str
    name_own: str
    numbering: str
    published_percent: float | None
    latin: Mapping[str, str]
    equivalents: Mapping[str, Equivalent]
    traffic: Traffic | None = None

    @property
    def count(self) -> int:
        """How many signs have an equivalent."""
        return sum(entry.exists for entry in self.equivalents.values())

    @property
    def known(self) -> int:
        """How many signs have an entry."""
        return sum(entry.code != _UNKNOWN for entry in self.equivalents.values())

    @property
    def percent(self) -> float:
        """Share of those with an entry that have an equivalent, 0-100."""
        return 100.0 * self.count / self.known if self.known else 0.0

    @property
    def checked(self) -> int:
        """How many entries, those without an equivalent included, rest on a source."""
        return sum(entry.checked for entry in self.equivalents.values())

    @property
    def unit(self) -> str:
        """Of speeds on its plates."""
        return "km/h" if self.traffic is None else self.traffic.unit

    def posted(self, kmh: float) -> float:
        """A speed as its plates show it: with miles the nearest one there is, a multiple of ten; 50 km/h are 30 mph."""
        return max(10.0, 10.0 * round(kmh / _KM_PER_MILE / 10.0)) if self.unit == "mph" else kmh

    def caption(self, sign: str) -> str:
        """The code that a picture gives a plate: the country's behind its two letters, in Latin letters."""
        entry = self.equivalents[sign]
        name = self.code.upper()
        return f"{name} {_in_latin(entry.code, self.latin)}" if entry.exists else f"{sign} ({name}: {entry.code})"


@dataclass(frozen=True)
class _Names:
    en: Text
    own: Text


@dataclass(frozen=True)
class _File:
    country: Text
    names: _Names
    numbering: Text
    signs: Mapping[str, Equivalent]
    published_percent: _Percent | None = None
    latin: Mapping[str, Text] = field(default_factory=dict)
    traffic: Traffic | None = None
    plates: Text | None = None


def load_country(code: str, root: Path | None = None) -> Country:
    """The country of a code, such as "de". Raises InputError: no such country, or file, key, what is wrong.

    root: the catalogue's folder; by default `sign_catalog/` of this repository.
    """
    folder, known = load_catalog(root).root / "countries", country_codes(root)
    if code not in known:
        raise InputError(f"{folder}: no country {code!r}: it has {', '.join(known)}")
    return _load(folder / f"{code}.yaml")


def country_codes(root: Path | None = None) -> tuple[str, ...]:
    """Those of all countries that have a file."""
    return tuple(path.stem for path in yaml_files(load_catalog(root).root / "countries"))


def load_countries(root: Path | None = None) -> tuple[Country, ...]:
    """All countries by code whose files list signs; raises as `load_country` does."""
    found = (_load(path) for path in yaml_files(load_catalog(root).root / "countries"))
    return tuple(country for country in found if country.known)


def city_country(city: str) -> Country | None:
    """The country of a city; None where no file says which, or that has no file."""
    return _of_city(data_file(f"cities/{city}.yaml"), data_file("sign_catalog/countries"))


@cache
def _of_city(city: Path, folder: Path) -> Country | None:
    told = textfile.read_yaml(city, "description of a city") if city.is_file() else {}
    path = folder / f"{str(told.get('country')).lower()}.yaml"
    return _load(path) if path.is_file() else None


@dataclass(frozen=True)
class Artwork:
    """How plates look and what they are called: as in a country, where that draws them, else as in the catalogue.

    asked: a user asked for this country; codes that it lacks are shown as lacking.
    """

    catalog: Catalog
    country: Country | None = None
    asked: bool = False

    @classmethod
    def of(cls, catalog: Catalog, city: str, country: Country | None = None) -> "Artwork":
        """Those of a city's country, or of the one that a user asks for."""
        return cls(catalog, country or city_country(city), country is not None)

    def drawing(self, code: str, value: float | None) -> tuple[Path, float | None]:
        """Of a plate: the file with its drawing, and the number that is printed on it."""
        sign, plates = self.catalog.sign(code), self.catalog.root / "plates"
        number = sign.effective_value(value)
        if self.country is None:
            return plates / sign.drawing, number
        own = self.country.equivalents[code].drawing
        if own is not None and self.catalog.image and (plates / "left" / own).is_file():
            own = f"left/{own}"
        return plates / (own or sign.drawing), None if number is None else self.country.posted(number)

    def code(self, sign: str) -> str:
        """The code that a picture's caption gives a plate."""
        if self.country is None or not (self.asked or self.country.equivalents[sign].exists):
            return sign
        return self.country.caption(sign)

    def value(self, value: float) -> str:
        """A posted speed (km/h) in words: its number alone, but where plates count in other units both."""
        if self.country is None or self.country.unit == "km/h":
            return f"{value:g}"
        return f"{self.country.posted(value):g} {self.country.unit} for {value:g} km/h"


def write_csv(catalog: Catalog, countries: Sequence[Country], path: Path) -> None:
    """One row per country and sign, UTF-8; the file's folder is made where it is missing.

    Raises
    ------
        InputError: the file cannot be written.
    """
    rows = [
        (
            country.code,
            sign,
            catalog.sign(sign).name_en,
            entry.code,
            entry.reason or "",
            entry.note or "",
            str(entry.checked).lower(),
        )
        for country in countries
        for sign, entry in country.equivalents.items()
    ]
    with io_errors_as_input_errors(path):
        write_atomic(path, csv_text([_COLUMNS, *rows]).encode())


def _in_latin(code: str, latin: Mapping[str, str]) -> str:
    for letter, written in latin.items():
        code = code.replace(letter, written)
    return code


@cache
def _load(path: Path) -> Country:
    catalog = load_catalog(path.parents[1])
    return read_sheet(_File, path, "country", lambda file: _country(file, catalog))


def _country(file: _File, catalog: Catalog) -> Country:
    for sign, entry in file.signs.items():
        if sign not in catalog.signs:
            raise ValueError(f"signs: {sign}: the catalogue has no such sign")
        if not _in_latin(entry.code, file.latin).isascii():
            raise ValueError(f"signs: {sign}: code {entry.code!r} needs its letters under latin")
        if entry.drawing is not None and not (catalog.root / "plates" / entry.drawing).is_file():
            raise ValueError(f"signs: {sign}: drawing: no {entry.drawing} in {catalog.root / 'plates'}")
    sides = driving_sides(catalog.root)
    if file.country not in sides:
        raise ValueError(f"country: {file.country!r} is no country's code of ISO 3166")
    if file.traffic is not None and file.traffic.side != sides[file.country]:
        raise ValueError(f"traffic: side: {file.traffic.side}: driving_sides.yaml says {sides[file.country]}")
    equivalents = {sign: file.signs.get(sign, Equivalent(_UNKNOWN, False)) for sign in catalog.signs}
    return Country(
        code=file.country,
        name_en=file.names.en,
        name_own=file.names.own,
        numbering=file.numbering,
        published_percent=file.published_percent,
        latin=file.latin,
        equivalents=_drawn_as(file.plates, equivalents, catalog),
        traffic=file.traffic,
    )


def _drawn_as(other: str | None, equivalents: Mapping[str, Equivalent], catalog: Catalog) -> Mapping[str, Equivalent]:
    """Entries without a drawing look as another country's, by its code, do."""
    if other is None:
        return equivalents
    path = catalog.root / "countries" / f"{other}.yaml"
    if not path.is_file():
        raise ValueError(f"plates: no country {other!r} in {path.parent}")
    looks = {sign: entry.drawing for sign, entry in read_sheet(_File, path, "country", _signs_of).items()}
    return {
        sign: entry if entry.drawing or entry.code == _NONE else replace(entry, drawing=looks.get(sign))
        for sign, entry in equivalents.items()
    }


def _signs_of(file: _File) -> Mapping[str, Equivalent]:
    return file.signs
