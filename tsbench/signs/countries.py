"""What a plate is called elsewhere: `sign_catalog/countries/<country>.yaml`, one entry for every sign.

The files are for readers: no rule, scene or record looks at them, and the catalogue's fingerprint leaves them out.
"""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.signs.catalog import Catalog, load_catalog
from tsbench.signs.parsing import open_file
from tsbench.signs.reading import Fields

_NONE = "none"
_COLUMNS = ("country", "sign", "name", "equivalent", "reason", "note", "checked")


@dataclass(frozen=True)
class Equivalent:
    """One country's sign for one sign of the catalogue.

    Attributes:
        sign: the catalogue's code, such as "3.24".
        code: the country's official code, or several that stand together ("220-20 + 1000-33"); None without one.
        reason: why there is none; None where there is one.
        note: what differs, else None.
        checked: whether the entry was found in a source other than memory.
    """

    sign: str
    code: str | None
    reason: str | None
    note: str | None
    checked: bool


@dataclass(frozen=True)
class Country:
    """A country's signs.

    Attributes:
        code: two small letters, also the file's name.
        name_en, name_own: in English and in its own language.
        numbering: the law or catalogue that numbers its signs.
        published_percent: share of signs with an equivalent that the spec quotes, 0-100.
        latin: how letters of its codes are written in a picture, whose fonts have Latin letters only.
        equivalents: by the catalogue's codes, in its order; covers all of them.
    """

    code: str
    name_en: str
    name_own: str
    numbering: str
    published_percent: float
    latin: Mapping[str, str]
    equivalents: Mapping[str, Equivalent]

    @property
    def count(self) -> int:
        """How many signs have an equivalent."""
        return sum(entry.code is not None for entry in self.equivalents.values())

    @property
    def percent(self) -> float:
        """Share of the signs with an equivalent, 0-100."""
        return 100.0 * self.count / len(self.equivalents)

    @property
    def checked(self) -> int:
        """How many entries, those without an equivalent included, rest on a source."""
        return sum(entry.checked for entry in self.equivalents.values())


def load_country(code: str, root: Path | None = None) -> Country:
    """The country of a code, such as "de".

    Args:
        code: name of a file in `countries/`, without its suffix.
        root: the catalogue's folder; by default `sign_catalog/` of this repository.

    Raises:
        InputError: one line: no such country, or file, key, what is wrong.
    """
    catalog = load_catalog(root)
    known = [path.stem for path in _files(catalog)]
    if code not in known:
        raise InputError(f"{catalog.root / 'countries'}: no country {code!r}: it has {', '.join(known)}")
    return _load(catalog.root, code)


def load_countries(root: Path | None = None) -> tuple[Country, ...]:
    """All countries by code; raises as `load_country` does."""
    catalog = load_catalog(root)
    return tuple(_load(catalog.root, path.stem) for path in _files(catalog))


def shown_code(sign: str, country: Country | None) -> str:
    """The code that a picture's caption gives a plate: the catalogue's, or the country's behind its two letters."""
    if country is None:
        return sign
    foreign = country.equivalents[sign].code
    name = country.code.upper()
    return f"{sign} ({name}: {_NONE})" if foreign is None else f"{name} {_in_latin(foreign, country.latin)}"


def write_csv(catalog: Catalog, countries: Sequence[Country], path: Path) -> None:
    """One row per country and sign, UTF-8; the file's folder is made where it is missing.

    Raises:
        InputError: the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(_COLUMNS)
            for country in countries:
                for entry in country.equivalents.values():
                    texts = (entry.code or _NONE, entry.reason or "", entry.note or "")
                    name = catalog.sign(entry.sign).name_en
                    writer.writerow((country.code, entry.sign, name, *texts, str(entry.checked).lower()))
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from error


def _in_latin(code: str, latin: Mapping[str, str]) -> str:
    for letter, written in latin.items():
        code = code.replace(letter, written)
    return code


def _files(catalog: Catalog) -> list[Path]:
    paths = sorted((catalog.root / "countries").glob("*.yaml"))
    if not paths:
        raise InputError(f"{catalog.root / 'countries'}: no YAML files here")
    return paths


@cache
def _load(root: Path, code: str) -> Country:
    top = open_file(root / "countries" / f"{code}.yaml")
    if (written := top.text("country")) != code:
        top.fail("country", f"{written!r} stands in the file of {code!r}")
    names, letters, signs = top.fields("names"), top.optional_fields("latin"), top.fields("signs")
    latin = {letter: letters.text(letter) for letter in letters.names()}
    equivalents = _equivalents(signs, load_catalog(root))
    for entry in equivalents.values():
        if entry.code is not None and not _in_latin(entry.code, latin).isascii():
            signs.fail(entry.sign, f"code {entry.code!r} needs its letters under latin")
    percent = top.number("published_percent")
    if not 0 <= percent <= 100:
        top.fail("published_percent", f"must lie between 0 and 100, not {percent:g}")
    country = Country(
        code=code,
        name_en=names.text("en"),
        name_own=names.text("own"),
        numbering=top.text("numbering"),
        published_percent=percent,
        latin=latin,
        equivalents=equivalents,
    )
    names.done()
    top.done()
    return country


def _equivalents(given: Fields, catalog: Catalog) -> dict[str, Equivalent]:
    """The entries in the catalogue's order: each of its signs, and no other."""
    for sign in given.names():
        if sign not in catalog.signs:
            given.fail(sign, "the catalogue has no such sign")
    return {sign: _equivalent(sign, given.fields(sign)) for sign in catalog.signs}


def _equivalent(sign: str, entry: Fields) -> Equivalent:
    code = entry.text("code")
    if not entry.has("checked"):
        entry.fail("checked", "is missing")
    if code != _NONE and entry.has("reason"):
        entry.fail("reason", f"goes with code: {_NONE} only; what differs is a note")
    equivalent = Equivalent(
        sign=sign,
        code=None if code == _NONE else code,
        reason=entry.text("reason") if code == _NONE else None,
        note=entry.text("note") if entry.has("note") else None,
        checked=entry.flag("checked"),
    )
    entry.done()
    return equivalent
