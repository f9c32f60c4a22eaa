"""A city as data: `cities/<name>.yaml` says what its data set is made from, and how its tiles are split."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from tsbench.core.benchmark import MAPS
from tsbench.core.errors import InputError
from tsbench.core.fetch import fetch_file
from tsbench.core.files import sha256_of, write_atomic
from tsbench.core.paths import LEFT, MIRRORED, RIGHT, cities_folder, city_in_use, driven_as, using_city
from tsbench.core.textfile import read_yaml
from tsbench.dataset.maps.names import extracts_in, file_at
from tsbench.dataset.maps.utm import UtmFrame
from tsbench.signs.countries import country_codes, load_country
from tsbench.signs.driving_side import country_code, driving_sides

SCHEMA_VERSION = 1
# A country's extract has less.
_MOST_BYTES = 1 << 34
# What a city's `types` may say besides the name of a type map: the town's, with its country's speeds.
COUNTRY_TYPES, TOWN_TYPES = "country", "town.typ.xml"
_KEYS = {"schema", "city", "title", "country", "side", "zone", "types", "split", "extracts"}
_MAY = {"maps", "withdrawn"}
_SPLIT_KEYS, _SPLIT_MAY = {"tile_m", "test_share"}, {"holdout", "dev"}
_EXTRACT_KEYS = {"name", "code", "well_tagged", "date", "address", "sha256", "bytes", "licence"}

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
    bytes: int
    licence: str
    rank: int = 0


@dataclass(frozen=True)
class SplitPlan:
    """How a city's tiles are split. tile_m: their side. test_share: of the tiles, drawn.

    holdout, dev: tiles by number from the frame's origin, eastwards and northwards. With dev tiles the rest is train;
    without any, all that is not test is dev.
    """

    tile_m: float
    test_share: float
    holdout: frozenset[Tile] = frozenset()
    dev: frozenset[Tile] = frozenset()

    @property
    def rest(self) -> str:
        return "train" if self.dev else "dev"


@dataclass(frozen=True)
class City:
    """What the data set of a city is made from.

    side: that traffic keeps to. zone: of UTM, the frame of all extracts: most nodes of each lie in it. types: its
    type map, in `sumo_nets/netconvert/`, or COUNTRY_TYPES.
    maps: of each type at most, by the splits that it has. withdrawn: ids of maps that no new scene is made on.
    """

    name: str
    title: str
    country: str
    side: str
    zone: int
    types: str
    split: SplitPlan
    maps: Mapping[str, int]
    extracts: tuple[Extract, ...]
    withdrawn: frozenset[str] = frozenset()

    @property
    def frame(self) -> UtmFrame:
        return UtmFrame(self.zone, mirrored=self.side == LEFT)

    @property
    def driven(self) -> str:
        """What `--city` has to name for roads to be as they are."""
        return driven_as(self.name, self.side)


def city_names() -> tuple[str, ...]:
    """Cities that are described, sorted."""
    return tuple(sorted(path.stem for path in cities_folder().glob("*.yaml")))


def chosen_city() -> City:
    """The city whose data set is in use (`--city`)."""
    return load_city(city_in_use())


def load_city(name: str) -> City:
    """The description of a city. Raises InputError (file, key, problem)."""
    path = cities_folder() / f"{name}.yaml"
    if name.startswith(MIRRORED):
        raise InputError(
            f"{name}: no city of its own, but {name.removeprefix(MIRRORED)} in a mirror (docs/guides/city.md)"
        )
    if not path.is_file():
        raise InputError(
            f"{path}: no such city; there are {', '.join(city_names()) or 'none'} (docs/guides/city.md)"
        )
    return _read(path, name)


@cache
def _read(path: Path, name: str) -> City:
    data = read_yaml(path, "description of a city")
    _keys(path, "", data, _KEYS, _MAY)
    if data["schema"] != SCHEMA_VERSION or data["city"] != name:
        raise InputError(f"{path}: expected `schema: {SCHEMA_VERSION}` and `city: {name}`")
    for key in ("title", "country", "types"):
        if not isinstance(data[key], str):
            raise InputError(f"{path}: {key}: must be text, not {data[key]!r:.80}")
    if data["side"] not in (RIGHT, LEFT):
        raise InputError(f"{path}: side: {data['side']!r:.80}: expected {RIGHT} or {LEFT}")
    country = country_code(data["country"], f"{path}: country")
    side = driving_sides()[country]
    if data["side"] != side:
        raise InputError(f"{path}: side: {data['side']}: traffic keeps to the {side} in {country!r}")
    if data["types"] == COUNTRY_TYPES and not has_speeds(country):
        raise InputError(
            f"{path}: types: no speeds are known of {country!r}: write {TOWN_TYPES}, "
            "or the country's file (docs/signs.md)"
        )
    _number(path, "zone", data["zone"], 1, 60, int)
    maps = data.get("maps", MAPS)
    if not isinstance(maps, dict) or not maps or set(maps) - set(MAPS):
        raise InputError(f"{path}: maps: expected numbers for some of {', '.join(MAPS)}")
    for split, count in maps.items():
        _number(path, f"maps: {split}", count, 1, max(MAPS.values()), int)
    withdrawn = data.get("withdrawn", [])
    if not isinstance(withdrawn, list) or not all(isinstance(one, str) for one in withdrawn):
        raise InputError(f"{path}: withdrawn: must be a list of map ids")
    return City(
        name, data["title"], country, data["side"], data["zone"], data["types"],
        _split(path, data["split"]), maps, _extracts(path, data["extracts"]), frozenset(withdrawn),
    )  # fmt: skip


def has_speeds(country: str) -> bool:
    """Does the file of a country, by its code, say how fast roads are?"""
    traffic = load_country(country).traffic if country in country_codes() else None
    return traffic is not None and bool(traffic.speeds)


def _split(path: Path, data: Any) -> SplitPlan:
    _keys(path, "split: ", data, _SPLIT_KEYS, _SPLIT_MAY)
    _number(path, "split: tile_m", data["tile_m"], 500, 20_000)
    _number(path, "split: test_share", data["test_share"], 0.0, 1.0)
    tiles = {key: data.get(key, []) for key in sorted(_SPLIT_MAY)}
    for key, found in tiles.items():
        if not isinstance(found, list) or not all(
            isinstance(tile, list) and len(tile) == 2 and all(type(n) is int for n in tile) for tile in found
        ):
            raise InputError(f"{path}: split: {key}: expected pairs of whole numbers")
    named = {key: frozenset((east, north) for east, north in found) for key, found in tiles.items()}
    return SplitPlan(float(data["tile_m"]), float(data["test_share"]), **named)


def _extracts(path: Path, data: Any) -> tuple[Extract, ...]:
    if not isinstance(data, list) or not data:
        raise InputError(f"{path}: extracts: must be a list of at least one")
    for k, entry in enumerate(data):
        where = f"extracts: number {k + 1}: "
        _keys(path, where, entry, _EXTRACT_KEYS, set())
        for key in sorted(_EXTRACT_KEYS - {"well_tagged", "bytes"}):
            if not isinstance(entry[key], str):
                raise InputError(f"{path}: {where}{key}: must be text (in quotes), not {entry[key]!r:.80}")
        if not isinstance(entry["well_tagged"], bool):
            raise InputError(f"{path}: {where}well_tagged: must be true or false")
        _number(path, f"{where}bytes", entry["bytes"], 1, _MOST_BYTES, int)
        if not re.fullmatch("[0-9a-f]{64}", entry["sha256"]):
            raise InputError(f"{path}: {where}sha256: must be 64 digits of 0-9 and a-f")
    for key in ("name", "code"):
        if len({entry[key] for entry in data}) < len(data):
            raise InputError(f"{path}: extracts: the same {key} stands twice")
    return tuple(Extract(**entry, rank=rank) for rank, entry in enumerate(data))


def check_extract(extract: Extract, path: Path) -> None:
    """Is the file the one that the city names? Raises InputError."""
    digest = sha256_of(path)
    if digest != extract.sha256 or path.stat().st_size != extract.bytes:
        raise InputError(
            f"{path}: SHA-256 {digest} is not that of '{extract.name}', {extract.sha256}; it is at {extract.address}"
        )


def new_city_file(name: str) -> Path:
    """Where a city is to be described. Raises InputError for a name that cannot be one or is taken."""
    with using_city(name):
        path = cities_folder() / f"{city_in_use()}.yaml"
    if path.exists():
        raise InputError(f"{path}: there is such a city already")
    return path


def describe_city(path: Path, title: str, country: str, zone: int, facts: Mapping[str, Any]) -> City:
    """Write the description of a city of one extract. facts: its date, address, sha256 and bytes."""
    name = path.stem
    types = COUNTRY_TYPES if has_speeds(country) else TOWN_TYPES
    extract = {
        "name": name,
        "code": name.replace("-", "")[:6],
        "well_tagged": True,
        **facts,
        "licence": "ODbL-1.0",
    }
    data = {
        "schema": SCHEMA_VERSION, "city": name, "title": title, "country": country,
        "side": driving_sides()[country], "zone": zone, "types": types,
        "split": {"tile_m": 2000, "test_share": 0.7}, "maps": {"test": 5, "dev": 1}, "extracts": [extract],
    }  # fmt: skip
    write_atomic(path, yaml.safe_dump(data, sort_keys=False, allow_unicode=True).encode())
    return load_city(name)


def fetch_extracts(name: str, osm_dir: Path, on_progress: Callable[[str], None]) -> None:
    """Bring a city's extracts that are not in the folder from their addresses.

    Raises InputError where one cannot be had or is not the one that the city is made of; others stay.
    """
    from tsbench.dataset.maps import overpass  # brings pyosmium, which who only runs need not have

    for extract in load_city(name).extracts:
        asked = overpass.is_address(extract.address)
        there = extracts_in(osm_dir, extract.name).get(extract.name)
        path = there or osm_dir / (
            f"{extract.name}.osm.gz" if asked else file_at(extract.name, extract.address)
        )
        if not path.exists() and asked:
            overpass.fetch_extract(path, extract.address)
        elif not path.exists():
            fetch_file(extract.address, extract.bytes, extract.sha256, path)
        check_extract(extract, path)
        on_progress(f"{path}: OpenStreetMap of {extract.date}, {extract.licence}")


def _keys(path: Path, where: str, data: Any, must: set[str], may: set[str]) -> None:
    if not isinstance(data, dict) or set(data) - may != must:
        more = f" and perhaps {', '.join(sorted(may))}" if may else ""
        raise InputError(f"{path}: {where}expected the keys {', '.join(sorted(must))}{more}")


def _number(path: Path, where: str, value: Any, least: float, most: float, kind: type = object) -> None:
    fits = isinstance(value, int | float) and not isinstance(value, bool) and isinstance(value, kind)
    if not fits or not least <= value <= most:
        raise InputError(f"{path}: {where}: {value!r:.80} is not in {least:g} to {most:g}")
