"""The file of what lies around a city's roads: buildings, greenery, water. Only pictures read it."""

from __future__ import annotations

import pyarrow as pa

from tsbench.core.parquet import VERSION_KEY, columns

GROUND_FILE = "ground.parquet"
# From the lowest to the highest in a picture.
GROUND_KINDS = ("green", "water", "building")
# shape: polygons as WKB, m in the frame of the map's network, not mirrored.
GROUND_SCHEMA = pa.schema(
    [*columns(pa.string(), "map_id", "kind"), *columns(pa.binary(), "shape")], metadata={VERSION_KEY: "1"}
)
