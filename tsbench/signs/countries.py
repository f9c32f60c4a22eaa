"""What a plate is called elsewhere: `sign_catalog/countries/<country>.yaml`; a sign without an entry there is unknown.

The files are for readers: no rule, scene or record looks at them, and the catalogue's fingerprint leaves them out.
"""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, replacing
from tsbench.signs.catalog import Catalog, load_catalog, yaml_files
from tsbench.signs.reading import read_file

_NONE, _UNKNOWN = "none", "unknown"
_COLUMNS = ("country", "sign", "name", "equivalent", "reason", "note", "checked")


@dataclass(frozen=True)
class Equivalent:
    """One country's sign for one sign of the catalogue.

    code: the country's official one, or several that stand together ("220-20 + 1000-33"), "none", or "unknown" where
    its file has no entry. reason: why there is none. note: what differs. checked: found in a source other than
    memory.
    """

    code: str
    checked: bool
    reason: str | None = None
    note: str | None = None

    def __post_init__(self) -> None:
        if (self.code == _NONE) != (self.reason is not None):
            missing = self.reason is None
            raise ValueError(
                "reason: is missing"
                if missing
                else "reason: goes with code: none only; what differs is a note"
            )

    @property
    def exists(self) -> bool:
        """Is there such a sign, as far as is known?"""
        return self.code not in (_NONE, _UNKNOWN)


@dataclass(frozen=True)
class Country:
    """A country's signs.

    code: two small letters, also the file's name. numbering: the law or catalogue that numbers its signs.
    published_percent: share of signs with an equivalent that the spec quotes, 0-100; None where it names none. latin:
    how letters of its codes are written in a picture, whose fonts have Latin letters only. equivalents: by the
    catalogue's codes, in its order; covers all of them.
    """

    code: str
    name_en: str
    name_own: str
    numbering: str
    published_percent: float | None
    latin: Mapping[str, str]
    equivalents: Mapping[str, Equivalent]

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

    def caption(self, sign: str) -> str:
        """The code that a picture gives a plate: the country's behind its two letters, in Latin letters."""
        entry = self.equivalents[sign]
        name = self.code.upper()
        return (
            f"{name} {_in_latin(entry.code, self.latin)}"
            if entry.exists
            else f"{sign} ({name}: {entry.code})"
        )


@dataclass(frozen=True)
class _Names:
    en: str
    own: str


@dataclass(frozen=True)
class _File:
    country: str
    names: _Names
    numbering: str
    signs: Mapping[str, Equivalent]
    published_percent: float | None = None
    latin: Mapping[str, str] = field(default_factory=dict)


def load_country(code: str, root: Path | None = None) -> Country:
    """The country of a code, such as "de". Raises InputError: no such country, or file, key, what is wrong.

    root: the catalogue's folder; by default `sign_catalog/` of this repository.
    """
    folder = load_catalog(root).root / "countries"
    known = [path.stem for path in yaml_files(folder)]
    if code not in known:
        raise InputError(f"{folder}: no country {code!r}: it has {', '.join(known)}")
    return _load(folder / f"{code}.yaml")


def load_countries(root: Path | None = None) -> tuple[Country, ...]:
    """All countries by code; raises as `load_country` does."""
    return tuple(_load(path) for path in yaml_files(load_catalog(root).root / "countries"))


def shown_code(sign: str, country: Country | None) -> str:
    """The code that a picture's caption gives a plate: the catalogue's, or a country's."""
    return sign if country is None else country.caption(sign)


def write_csv(catalog: Catalog, countries: Sequence[Country], path: Path) -> None:
    """One row per country and sign, UTF-8; the file's folder is made where it is missing.

    Raises
    ------
        InputError: the file cannot be written.
    """
    with (
        io_errors_as_input_errors(path),
        replacing(path) as part,
        part.open("w", encoding="utf-8", newline="") as file,
    ):
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(_COLUMNS)
        for country in countries:
            for sign, entry in country.equivalents.items():
                texts = (entry.code, entry.reason or "", entry.note or "", str(entry.checked).lower())
                writer.writerow((country.code, sign, catalog.sign(sign).name_en, *texts))


def _in_latin(code: str, latin: Mapping[str, str]) -> str:
    for letter, written in latin.items():
        code = code.replace(letter, written)
    return code


@cache
def _load(path: Path) -> Country:
    catalog = load_catalog(path.parents[1])
    return read_file(_File, path, "country", lambda file: _country(file, catalog))


def _country(file: _File, catalog: Catalog) -> Country:
    for sign, entry in file.signs.items():
        if sign not in catalog.signs:
            raise ValueError(f"signs: {sign}: the catalogue has no such sign")
        if not _in_latin(entry.code, file.latin).isascii():
            raise ValueError(f"signs: {sign}: code {entry.code!r} needs its letters under latin")
    percent = file.published_percent
    if percent is not None and not 0 <= percent <= 100:
        raise ValueError(f"published_percent: must lie between 0 and 100, not {percent:g}")
    return Country(
        code=file.country,
        name_en=file.names.en,
        name_own=file.names.own,
        numbering=file.numbering,
        published_percent=percent,
        latin=file.latin,
        equivalents={sign: file.signs.get(sign, Equivalent(_UNKNOWN, False)) for sign in catalog.signs},
    )
