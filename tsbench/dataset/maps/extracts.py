"""The extracts of the city in use: which they are, where they lie, the best tagged first."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import osmium

from tsbench.core.errors import InputError
from tsbench.core.files import sha256_of
from tsbench.core.paths import OWN_CITY
from tsbench.dataset.city import Extract, check_extract, chosen_city
from tsbench.dataset.maps.names import SUFFIXES, check_file, ending_of, extract_name, extracts_in, opened_xml
from tsbench.dataset.maps.versions import contents_of, osm_file


def extract_info(name: str) -> Extract:
    """An extract of the city; another counts as well tagged, ranks after those, and is its own code."""
    known = chosen_city().extracts
    other = Extract(name, name, True, "", "", "", 0, "", rank=len(known))
    return next((extract for extract in known if extract.name == name), other)


def by_preference(names: list[str]) -> list[str]:
    """The names with well-tagged extracts first, in the city's order, then by name."""
    infos = [extract_info(name) for name in names]
    return [info.name for info in sorted(infos, key=lambda e: (not e.well_tagged, e.rank, e.name))]


def find_extract(name: str, osm_dir: Path) -> Path:
    """The extract called `name` in a folder, whatever its kind. Raises InputError for none or two."""
    found = extracts_in(osm_dir, name)
    if name in found:
        return found[name]
    address = extract_info(name).address
    other = next((f" ({path.name} is not called so: rename it)" for path in found.values()), "")
    raise InputError(
        f"{osm_dir}: no extract '{name}' here ({name}.osm.gz or like){other}; "
        + (f"it is at {address}, " if address else "")
        + "`tsbench maps fetch` gets extracts, or name their folder with --osm"
    )


def list_extracts(osm_dir: Path) -> list[Path]:
    """The extracts of a folder that a harvest takes, by name.

    For Moscow all that lie there. For another city those that it names, each with its SHA-256.
    """
    if not osm_dir.is_dir():
        raise InputError(
            f"{osm_dir}: no such folder of OSM extracts; `tsbench maps fetch` gets some, or use --osm DIR"
        )
    city = chosen_city()
    if city.name != OWN_CITY:
        named = {find_extract(extract.name, osm_dir): extract for extract in city.extracts}
        for path, extract in named.items():
            check_extract(extract, path)
        return sorted(named)
    found = sorted(extracts_in(osm_dir).values())
    if not found:
        raise InputError(f"{osm_dir}: no OSM extract in it (looked for {', '.join(SUFFIXES)})")
    return found


# Where the head of a file gives its time: in PBF, and in answers of Overpass.
_HEAD = ("osmosis_replication_timestamp", "timestamp")
_META = re.compile(rb'<meta osm_base=["\'](\d{4}-\d\d-\d\d)')
_LOOKED_AT = 1 << 16
_EPOCH = "1970-01-01"


def facts_of(
    path: Path, date: str | None, address: str | None
) -> tuple[int, dict[str, Any], tuple[str, ...]]:
    """The UTM zone of an extract, its keys in a city's file, and what of it is left out.

    date: of OpenStreetMap; None: as the file says. address: where it can be had; None: only its name is known.
    Raises InputError for a file that is no whole extract, has no node, or does not say its date.
    """
    check_file(path)
    contents = contents_of(path)
    zone = contents.places.zone
    if not zone:
        raise InputError(f"{path}: no node of it has a place: this is no map")
    day = date or date_of(path)
    if day is None:
        raise InputError(f"{path}: does not say of which day it is: say it with --date YYYY-MM-DD")
    named = {"name": extract_name(path), "date": day, "address": address or f"the file {path.name}"}
    return zone, {**named, "sha256": sha256_of(path), "bytes": path.stat().st_size}, contents.lines


def date_of(path: Path) -> str | None:
    """The day (YYYY-MM-DD) of an extract's roads: by its head, else by its newest object, else None."""
    with osmium.io.Reader(osm_file(path), osmium.osm.NOTHING) as reader:
        head = reader.header()
        told: str | None = next((day for key in _HEAD if (day := head.get(key)[: len(_EPOCH)])), None)
    if told is None and not ending_of(path.name).endswith("pbf"):
        with opened_xml(path) as stream:
            found = _META.search(stream.read(_LOOKED_AT))
        told = found and found[1].decode()
    if told:
        return told
    newest = max(
        (f"{one.timestamp:%Y-%m-%d}" for one in osmium.FileProcessor(osm_file(path))), default=_EPOCH
    )
    return newest if newest > _EPOCH else None
