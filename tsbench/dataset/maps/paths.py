"""Where the map data lives, below the repository's `sumo_nets/`."""

from __future__ import annotations

from pathlib import Path

from tsbench.core.paths import data_file, data_root, dataset_root
from tsbench.dataset.city import chosen_city


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
    """The city's type map: what netconvert takes for lanes, speeds and widths by road class."""
    return netconvert_file(chosen_city().types)


def made_pool() -> Path:
    """Where a harvest writes the city's pool; its counts lie beside it."""
    return dataset_root() / "sumo_nets" / "pool.parquet"
