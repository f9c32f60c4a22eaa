"""Places of the pool's maps and of those that scenarios use, for a map that is drawn in the page."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np

from tsbench.core.parquet import open_table
from tsbench.report.page.packing import pack
from tsbench.scenarios.map_pool import POOL_SCHEMA, pool_file
from tsbench.scenarios.spec import ScenarioSpec

_COLUMNS = ("map_id", "source", "east", "north", "lat", "lon", "road_class")


def pack_places(rows: Sequence[ScenarioSpec]) -> bytes:
    """Header: unit (m), east0, north0 (UTM 37 north), sources [name, x, y], used maps; arrays x, y of the whole pool.

    A used map: id, x, y, lat, lon, road class, source, split, types.
    """
    table = open_table(pool_file(), POOL_SCHEMA, "tsbench maps harvest makes it", _COLUMNS)
    column: dict[str, list[Any]] = {name: table[name].to_pylist() for name in _COLUMNS}
    east, north = np.array(column["east"]), np.array(column["north"])
    middle = (float(np.median(east)), float(np.median(north)))
    reach = max(float(np.abs(east - middle[0]).max()), float(np.abs(north - middle[1]).max()))
    unit = max(round(reach / 32_000 + 0.5), 1)
    x, y = (np.rint((a - m) / unit).astype(np.int16) for a, m in zip((east, north), middle, strict=True))
    place = {name: k for k, name in enumerate(column["map_id"])}
    types: dict[str, set[str]] = defaultdict(set)
    splits: dict[str, str] = {}
    for row in rows:
        types[row.map_id].add(row.scenario_type)
        splits[row.map_id] = row.split
    used: list[dict[str, Any]] = []
    for name in sorted(types):
        k = place[name]
        used.append(
            {
                "id": name,
                "x": int(x[k]),
                "y": int(y[k]),
                "lat": round(column["lat"][k], 5),
                "lon": round(column["lon"][k], 5),
                "road": column["road_class"][k],
                "source": column["source"][k],
                "split": splits[name],
                "types": sorted(types[name]),
            }
        )
    header = {"unit": unit, "sources": _sources(column["source"], x, y), "used": used}
    order = np.lexsort((y, x))
    return pack(header, {"x": x[order], "y": y[order]})


def _sources(names: Sequence[str], x: Any, y: Any) -> list[list[Any]]:
    """Name and middle of each extract, largest first."""
    by_name = defaultdict(list)
    for k, name in enumerate(names):
        by_name[name].append(k)
    ordered = sorted(by_name.items(), key=lambda item: (-len(item[1]), item[0]))
    return [[name, int(np.median(x[ks])), int(np.median(y[ks])), len(ks)] for name, ks in ordered]
