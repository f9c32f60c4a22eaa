"""The extracts of the city in use: which they are, where they lie, the best tagged first."""

from __future__ import annotations

from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.core.paths import OWN_CITY
from tsbench.make.city import Extract, check_extract, chosen_city
from tsbench.make.maps.names import SUFFIXES, extracts_in


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
        raise InputError(f"{osm_dir}: no such folder of OSM extracts; `tsbench maps fetch` gets some, or use --osm DIR")
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
