"""Where the map data lives, below the repository's `sumo_nets/`."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from lxml import etree

from tsbench.core.files import write_atomic
from tsbench.core.paths import data_file, data_root
from tsbench.core.xmlfile import parse
from tsbench.make.city import COUNTRY_TYPES, TOWN_TYPES, chosen_city
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.countries import load_country


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


def types_file() -> Path:
    """The city's type map: what netconvert takes for lanes, speeds and widths by road class.

    One with its country's speeds is made below `build_dir()`, the same bytes each time.
    """
    city = chosen_city()
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


def made_pool() -> Path:
    """Where a harvest writes the city's pool; its counts lie beside it."""
    return DataSet.in_use().folder / "sumo_nets" / "pool.parquet"
