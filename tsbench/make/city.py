"""A city as data: `cities/<name>.yaml` says what its data set is made from, and how its tiles are split.

With it stand the folders of map data below `sumo_nets/`, and the extracts of a city, the best tagged first.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import yaml
from lxml import etree
from msgspec import Meta

from tsbench.core.benchmark import MAPS
from tsbench.core.errors import InputError
from tsbench.core.fetch import fetch_file
from tsbench.core.files import sha256_of, write_atomic
from tsbench.core.paths import (
    LEFT,
    MIRRORED,
    OWN_CITY,
    checked_city,
    cities_folder,
    city_names,
    data_file,
    data_root,
    driven_as,
)
from tsbench.core.typed import SCHEMA, read_sheet
from tsbench.core.xmlfile import parse
from tsbench.make.maps import extracts
from tsbench.make.maps.extracts import SUFFIXES, extracts_in, file_at
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
        asked = extracts.is_address(extract.address)
        there = extracts_in(osm_dir, extract.name).get(extract.name)
        path = there or osm_dir / (f"{extract.name}.osm.gz" if asked else file_at(extract.name, extract.address))
        if not path.exists() and asked:
            extracts.fetch_extract(path, extract.address)
        elif not path.exists():
            fetch_file(extract.address, extract.bytes, extract.sha256, path)
        check_extract(extract, path)
        on_progress(f"{path}: OpenStreetMap of {extract.date}, {extract.licence}")


def sumo_nets() -> Path:
    """The folder that map data is made in: extracts, what was made of them, the pool's index."""
    return data_root() / "sumo_nets"


def sources_dir() -> Path:
    """Default folder of OSM extracts (not committed; `tsbench maps fetch` fills it)."""
    return sumo_nets() / "sources"


def build_dir() -> Path:
    """Everything that can be made again: parsed networks, harvest progress (not committed)."""
    return sumo_nets() / "build"


def netconvert_file(name: str) -> Path:
    return data_file(f"sumo_nets/netconvert/{name}")


def types_file(data: DataSet) -> Path:
    """The city's type map: what netconvert takes for lanes, speeds and widths by road class.

    One with its country's speeds is made below `build_dir()`, the same bytes each time.
    """
    city = load_city(data.name)
    if city.types != COUNTRY_TYPES:
        return netconvert_file(city.types)
    made = build_dir() / "types" / f"{city.country}.typ.xml"
    return _types_of_country(city.country, netconvert_file(TOWN_TYPES), made)


@cache
def _types_of_country(code: str, town: Path, made: Path) -> Path:
    """Write a town's type map with the limits that hold in a country where no plate says otherwise."""
    traffic = load_country(code).traffic
    assert traffic is not None, "load_city has looked"
    root = parse(town.read_bytes(), town, "types", "type map")
    for road, speed in traffic.speeds_mps.items():
        for kind in root.iterfind(f"type[@id='highway.{road}']"):
            kind.set("speed", f"{speed:.2f}")
    content = etree.tostring(root, encoding="UTF-8")
    if not made.is_file() or made.read_bytes() != content:
        write_atomic(made, content)
    return made


def made_pool(data: DataSet) -> Path:
    """Where a harvest writes the city's pool; its counts lie beside it."""
    return data.folder / "sumo_nets" / "pool.parquet"


def extract_info(data: DataSet, name: str) -> Extract:
    """An extract of the city; another counts as well tagged, ranks after those, and is its own code."""
    known = load_city(data.name).extracts
    other = Extract(name, name, True, "", "", "", 0, "", rank=len(known))
    return next((extract for extract in known if extract.name == name), other)


def by_preference(data: DataSet, names: list[str]) -> list[str]:
    """The names with well-tagged extracts first, in the city's order, then by name."""
    infos = [extract_info(data, name) for name in names]
    return [info.name for info in sorted(infos, key=lambda e: (not e.well_tagged, e.rank, e.name))]


def find_extract(data: DataSet, name: str, osm_dir: Path) -> Path:
    """The extract called `name` in a folder, whatever its kind. Raises InputError for none or two."""
    found = extracts_in(osm_dir, name)
    if name in found:
        return found[name]
    address = extract_info(data, name).address
    other = next((f" ({path.name} is not called so: rename it)" for path in found.values()), "")
    raise InputError(
        f"{osm_dir}: no extract '{name}' here ({name}.osm.gz or like){other}; "
        + (f"it is at {address}, " if address else "")
        + "`tsbench maps fetch` gets extracts, or name their folder with --osm"
    )


def list_extracts(data: DataSet, osm_dir: Path) -> list[Path]:
    """The extracts of a folder that a harvest takes, by name.

    For Moscow all that lie there. For another city those that it names, each with its SHA-256.
    """
    if not osm_dir.is_dir():
        raise InputError(f"{osm_dir}: no such folder of OSM extracts; `tsbench maps fetch` gets some, or use --osm DIR")
    city = load_city(data.name)
    if city.name != OWN_CITY:
        named = {find_extract(data, extract.name, osm_dir): extract for extract in city.extracts}
        for path, extract in named.items():
            check_extract(extract, path)
        return sorted(named)
    found = sorted(extracts_in(osm_dir).values())
    if not found:
        raise InputError(f"{osm_dir}: no OSM extract in it (looked for {', '.join(SUFFIXES)})")
    return found
