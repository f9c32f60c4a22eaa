"""The pool of maps: one frozen row per map, kept in `sumo_nets/pool.parquet`."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from tsbench.core.parquet import OSM_LICENCE, VERSION_KEY, fields_of, open_table, read_rows, save_rows

SCHEMA_VERSION = 1
FAMILIES = ("junction", "roundabout", "dual_path", "corridor")
SLOTS = ("s_l", "s_r", "l_s", "l_r", "r_s", "r_l")


@dataclass(frozen=True, slots=True)
class PoolRow:
    """One map of the pool. Metres, m/s, degrees; places in the UTM frame of their city, the same for all its sources.

    `shape`: T | X | ring | straight | curved. `slot` (dual path, else ""): prohibited, compliant manoeuvre.
    `east`/`north`: middle of the crop's bounding box, `half_w`/`half_h`: half its sides. `lanes`: most per
    direction; `lane_bucket`: that, 3 for more. `curvature`: chord over arc of the main line. `length_m`: of
    the corridor, the shortest arm, the ring, or the longer way. `detail`: the family's own fields, JSON, see
    docs/maps.md.
    """

    map_id: str
    family: str
    shape: str
    slot: str
    lat: float
    lon: float
    source: str
    well_tagged: bool
    osm_ids: tuple[int, ...]
    junction_ids: tuple[str, ...]
    east: float
    north: float
    half_w: float
    half_h: float
    lanes: int
    lane_bucket: int
    oneway: bool
    curvature: float
    length_m: float
    speed_mps: float
    road_class: str
    detail: str

    @property
    def fields(self) -> dict[str, Any]:
        parsed: dict[str, Any] = json.loads(self.detail)
        return parsed


# Its columns may hold nulls since its first version, though none does.
POOL_SCHEMA = pa.schema(fields_of(PoolRow, nullable=True)).with_metadata(
    {VERSION_KEY: str(SCHEMA_VERSION), **OSM_LICENCE}
)
_HINT = "`tsbench maps harvest --osm DIR` makes it"


def map_id(family: str, code: str, *ids: str) -> str:
    """A stable name such as `j-nwm-3f9a1c20`: family, extract, and a digest of the source's own ids."""
    digest = hashlib.blake2b("\n".join(ids).encode(), digest_size=5).hexdigest()
    return f"{family[0]}-{code}-{digest}"


def write_pool(rows: Sequence[PoolRow], path: Path) -> None:
    save_rows(rows, path, POOL_SCHEMA)


def read_pool(path: Path) -> list[PoolRow]:
    """All rows, sorted by `map_id`. InputError for a file that is missing, broken or of another schema."""
    return read_rows(PoolRow, path, POOL_SCHEMA, _HINT)


def known_map_ids(path: Path) -> frozenset[str]:
    """Ids of all maps in the index, without reading the rest. Raises InputError."""
    return frozenset(str(m) for m in open_table(path, POOL_SCHEMA, _HINT, ["map_id"])["map_id"].to_pylist())
