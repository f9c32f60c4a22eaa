"""What is known about the extracts: `sumo_nets/harvest.yaml`, the best tagged first."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from tsbench.core.errors import InputError
from tsbench.core.paths import data_file
from tsbench.core.textfile import read_yaml


@dataclass(frozen=True)
class Extract:
    """An extract's name, its short code in map ids, and whether lanes and shapes are as surveyed."""

    name: str
    code: str
    well_tagged: bool
    rank: int


@cache
def known_extracts() -> dict[str, Extract]:
    path = data_file("sumo_nets/harvest.yaml")
    content = read_yaml(path, "list of extracts")
    if not isinstance(content, dict) or content.get("schema") != 1:
        raise InputError(f"{path}: expected `schema: 1`")
    return {
        entry["name"]: Extract(entry["name"], entry["code"], bool(entry["well_tagged"]), rank)
        for rank, entry in enumerate(content["extracts"])
    }


def extract_info(name: str) -> Extract:
    """A known extract; an unknown one counts as well tagged, ranks after those, and is its own code."""
    known = known_extracts()
    return known.get(name, Extract(name, name, True, len(known)))


def by_preference(names: list[str]) -> list[str]:
    """The names with well-tagged extracts first, in the file's order, then by name."""
    infos = [extract_info(name) for name in names]
    return [info.name for info in sorted(infos, key=lambda e: (not e.well_tagged, e.rank, e.name))]
