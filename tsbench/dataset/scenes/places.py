"""Which maps are one place, so that their figures are correlated. Source: docs/metrics.md, "Aggregation"."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from tsbench.dataset.scenes.split import APART_M, extents
from tsbench.scenarios.map_pool import PoolRow
from tsbench.scenarios.spec import ScenarioSpec


def places_of(maps: Sequence[PoolRow]) -> dict[str, str]:
    """map_id -> place, named after the first of its maps by id.

    Maps within 300 m of each other are one place, all maps of one ring, and all of one OSM way; and so is whatever
    these join. Which maps are there decides: one between two others may make them one place.
    """
    if not maps:
        return {}
    maps = sorted(maps, key=lambda m: m.map_id)
    boxes = extents(maps)
    pairs = shapely.STRtree(boxes).query(boxes, predicate="dwithin", distance=APART_M).T.tolist()
    first: dict[object, int] = {}
    for k, row in enumerate(maps):
        rings = [(row.source, *row.junction_ids)] if row.family == "roundabout" else []
        pairs += [(first.setdefault(key, k), k) for key in (*row.osm_ids, *rings)]
    a, b = np.array(pairs).T
    joined = coo_array((np.ones(len(a), dtype=bool), (a, b)), shape=(len(maps), len(maps)))
    _, label = connected_components(joined, directed=False)
    named: dict[int, str] = {}
    return {row.map_id: named.setdefault(n, row.map_id) for row, n in zip(maps, label.tolist(), strict=True)}


def with_places(rows: Sequence[ScenarioSpec], pool: Sequence[PoolRow]) -> list[ScenarioSpec]:
    """The rows of one table with their places, as its maps make them; "" for a map that the pool does not have."""
    used = {row.map_id for row in rows}
    place = places_of([m for m in pool if m.map_id in used])
    return [replace(row, place=place.get(row.map_id, "")) for row in rows]
