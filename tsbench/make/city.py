"""A city as data: `cities/<name>.yaml` says what its data set is made from, and how its tiles are split."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import yaml
from msgspec import Meta

from tsbench.core.benchmark import MAPS
from tsbench.core.errors import InputError
from tsbench.core.fetch import fetch_file
from tsbench.core.files import sha256_of, write_atomic
from tsbench.core.paths import LEFT, MIRRORED, checked_city, cities_folder, city_names, driven_as
from tsbench.core.typed import SCHEMA, read_sheet
from tsbench.make.maps import overpass
from tsbench.make.maps.names import extracts_in, file_at
from tsbench.make.maps.utm import UtmFrame
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.countries import Side, country_code, country_codes, driving_sides, load_country

# A country's extract has less.
_MOST_BYTES = 1 << 34
# What a city's `types` may say besides the name of a type map: the town's, with its country's speeds.
COUNTRY_TYPES, TOWN_TYPES = "country", "town.typ.xml"
Tile = tuple[int, int]


@dataclass(frozen=True)
class Extract:
    """An OSM extract. code: short name in map ids. well_tagged: lanes and shapes are as surveyed. rank: in its city."""

    name: str
    code: str
    well_tagged: bool
    date: str
    address: str
    sha256: str
    bytes: Annotated[int, Meta(ge=1, le=_MOST_BYTES)]
    licence: str
    rank: int = 0


@dataclass(frozen=True)
class SplitPlan:
    """How a city's tiles are split. tile_m: their side. test_share: of the tiles, drawn.

    holdout, dev: tiles by number from the frame's origin, eastwards and northwards. With dev tiles the rest is train;
    without any, all that is not test is dev.
    """

    tile_m: Annotated[float, Meta(ge=500, le=20_000)]
    test_share: Annotated[float, Meta(ge=0, le=1)]
    holdout: frozenset[Tile] = frozenset()
    dev: frozenset[Tile] = frozenset()

    @property
    def rest(self) -> str:
        return "train" if self.dev else "dev"


@dataclass(frozen=True)
class City:
    """What the data set of a city is made from.

    city: its name. side: that traffic keeps to. zone: of UTM, the frame of all extracts: most nodes of each lie in it.
    types: its type map, in `sumo_nets/netconvert/`, or COUNTRY_TYPES.
    maps: of each type at most, by the splits that it has. withdrawn: ids of maps that no new scene is made on.
    """

    city: str
    title: str
    country: str
    side: Side
    zone: Annotated[int, Meta(ge=1, le=60)]
    types: str
    split: SplitPlan
    extracts: Annotated[tuple[Extract, ...], Meta(min_length=1)]
    maps: Mapping[str, Annotated[int, Meta(ge=1, le=max(MAPS.values()))]] = field(default_factory=lambda: MAPS)
    withdrawn: frozenset[str] = frozenset()

    @property
    def name(self) -> str:
        return self.city

    @property
    def frame(self) -> UtmFrame:
        return UtmFrame(self.zone, mirrored=self.side == LEFT)

    @property
    def driven(self) -> str:
        """What `--city` has to name for roads to be as they are."""
        return driven_as(self.name, self.side)


def chosen_city() -> City:
    """The city whose data set is in use (`--city`)."""
    return load_city(DataSet.in_use().name)


def load_city(name: str) -> City:
    """The description of a city. Raises InputError (file, key, problem)."""
    path = cities_folder() / f"{name}.yaml"
    if name.startswith(MIRRORED):
        raise InputError(
            f"{name}: no city of its own, but {name.removeprefix(MIRRORED)} in a mirror (docs/guides/city.md)"
        )
    if not path.is_file():
        raise InputError(f"{path}: no such city; there are {', '.join(city_names()) or 'none'} (docs/guides/city.md)")
    return _read(path)


@cache
def _read(path: Path) -> City:
    return read_sheet(City, path, "city", lambda city: _checked(city, path))


def _checked(city: City, path: Path) -> City:
    country = country_code(city.country, f"{path}: country")
    if city.side != (side := driving_sides()[country]):
        raise ValueError(f"side: {city.side}: traffic keeps to the {side} in {country!r}")
    if city.types == COUNTRY_TYPES and not has_speeds(country):
        raise ValueError(
            f"types: no speeds are known of {country!r}: write {TOWN_TYPES}, or the country's file (docs/signs.md)"
        )
    if not city.maps or set(city.maps) - set(MAPS):
        raise ValueError(f"maps: expected numbers for some of {', '.join(MAPS)}")
    if any(not re.fullmatch("[0-9a-f]{64}", extract.sha256) for extract in city.extracts):
        raise ValueError("extracts: sha256: must be 64 digits of 0-9 and a-f")
    for key in ("name", "code"):
        if len({getattr(extract, key) for extract in city.extracts}) < len(city.extracts):
            raise ValueError(f"extracts: the same {key} stands twice")
    ranked = tuple(replace(extract, rank=rank) for rank, extract in enumerate(city.extracts))
    return replace(city, country=country, extracts=ranked)


def has_speeds(country: str) -> bool:
    """Does the file of a country, by its code, say how fast roads are?"""
    traffic = load_country(country).traffic if country in country_codes() else None
    return traffic is not None and bool(traffic.speeds)


def check_extract(extract: Extract, path: Path) -> None:
    """Is the file the one that the city names? Raises InputError."""
    digest = sha256_of(path)
    if digest != extract.sha256 or path.stat().st_size != extract.bytes:
        raise InputError(
            f"{path}: SHA-256 {digest} is not that of '{extract.name}', {extract.sha256}; it is at {extract.address}"
        )


def new_city_file(name: str) -> Path:
    """Where a city is to be described. Raises InputError for a name that cannot be one or is taken."""
    path = cities_folder() / f"{checked_city(name)}.yaml"
    if path.exists():
        raise InputError(f"{path}: there is such a city already")
    return path


def describe_city(path: Path, title: str, country: str, zone: int, facts: Mapping[str, Any]) -> City:
    """Write the description of a city of one extract. facts: its date, address, sha256 and bytes."""
    name = path.stem
    types = COUNTRY_TYPES if has_speeds(country) else TOWN_TYPES
    extract = {"name": name, "code": name.replace("-", "")[:6], "well_tagged": True, **facts, "licence": "ODbL-1.0"}
    data = {
        "schema": SCHEMA, "city": name, "title": title, "country": country,
        "side": driving_sides()[country], "zone": zone, "types": types,
        "split": {"tile_m": 2000, "test_share": 0.7}, "maps": {"test": 5, "dev": 1}, "extracts": [extract],
    }  # fmt: skip
    write_atomic(path, yaml.safe_dump(data, sort_keys=False, allow_unicode=True).encode())
    return load_city(name)


def fetch_extracts(name: str, osm_dir: Path, on_progress: Callable[[str], None]) -> None:
    """Bring a city's extracts that are not in the folder from their addresses.

    Raises InputError where one cannot be had or is not the one that the city is made of; others stay.
    """
    for extract in load_city(name).extracts:
        asked = overpass.is_address(extract.address)
        there = extracts_in(osm_dir, extract.name).get(extract.name)
        path = there or osm_dir / (f"{extract.name}.osm.gz" if asked else file_at(extract.name, extract.address))
        if not path.exists() and asked:
            overpass.fetch_extract(path, extract.address)
        elif not path.exists():
            fetch_file(extract.address, extract.bytes, extract.sha256, path)
        check_extract(extract, path)
        on_progress(f"{path}: OpenStreetMap of {extract.date}, {extract.licence}")
