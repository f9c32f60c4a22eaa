"""What lies around a map's roads, faintly: buildings, greenery, water, where the city's data has them."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from types import MappingProxyType

import numpy as np
import shapely

from tsbench.core.parquet import GROUND_FILE, GROUND_KINDS, GROUND_SCHEMA, open_table
from tsbench.core.paths import dataset_file, mirrored_in_use
from tsbench.report.drawing.shapes import Area

_MIRROR = np.array((-1.0, 1.0))


def ground_shapes(map_id: str) -> tuple[Area, ...]:
    """Of a map of the data set in use, lowest first; () where nothing is known. Raises InputError: a broken file."""
    path = dataset_file(GROUND_FILE)
    if not path.is_file():
        return ()
    shapes = _of_maps(path).get(map_id, ())
    if not mirrored_in_use():
        return shapes
    return tuple(
        Area(one.colour, shapely.transform(one.polygon, lambda points: points * _MIRROR)) for one in shapes
    )


@lru_cache(maxsize=4)
def _of_maps(path: Path) -> MappingProxyType[str, tuple[Area, ...]]:
    found: dict[str, list[Area]] = {}
    for row in open_table(path, GROUND_SCHEMA, "tsbench city ground NAME --osm DIR").to_pylist():
        if row["kind"] in GROUND_KINDS:
            found.setdefault(row["map_id"], []).append(Area(row["kind"], shapely.from_wkb(row["shape"])))
    return MappingProxyType({name: tuple(shapes) for name, shapes in found.items()})
