"""The split of the whole pool by place, before any sign is assigned.

Source: docs/scenes.md, "Split". A city is cut into square tiles (a common metric frame for all its extracts), as
its `cities/<name>.yaml` says. Moscow: tiles of 2 km, a fifth of them test; one district is holdout, never
learned from, and a few tiles of what would be train are dev. A map whose extent comes within 300 m of another split's
without being one of it belongs to none, so that no place, road or junction is in two, whatever extract it was cut from.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from tsbench.make.city import SplitPlan, Tile
from tsbench.make.seeds import root_sequence
from tsbench.scenarios.map_pool import PoolRow
from tsbench.scenarios.spec import ScenarioSpec

APART_M = 300.0
CANDIDATES = 400
BUFFER = "buffer"


def tile_of(row: PoolRow, tile_m: float) -> Tile:
    """The tile that holds the middle of a map."""
    return math.floor(row.east / tile_m), math.floor(row.north / tile_m)


def _stratum(row: PoolRow) -> str:
    lanes = str(row.lane_bucket) if row.family == "corridor" else ""
    return f"{row.family}/{row.shape}/{row.slot}/{lanes}/{'tagged' if row.well_tagged else 'plain'}"


def choose_test_tiles(rows: Sequence[PoolRow], plan: SplitPlan) -> frozenset[Tile]:
    """The tiles of the test split: of 400 seeded draws, the one closest to the plan's share in every stratum.

    Strata: family, shape, slot, lane bucket, tagging. Roundabouts have no say: one ring is many maps of one place.
    """
    rows = [r for r in rows if r.family != "roundabout"] or rows
    tile = {r.map_id: tile_of(r, plan.tile_m) for r in rows}
    tiles = sorted(set(tile.values()))
    column = {t: i for i, t in enumerate(tiles)}
    strata = {name: i for i, name in enumerate(sorted({_stratum(r) for r in rows}))}
    counts = np.zeros((len(strata), len(tiles)))
    for row in rows:
        counts[strata[_stratum(row)], column[tile[row.map_id]]] += 1
    share = counts / counts.sum(axis=1, keepdims=True)
    weight = np.sqrt(counts.sum(axis=1))
    rng = np.random.default_rng(root_sequence(0x5917))
    best, best_cost = np.zeros(len(tiles), dtype=bool), math.inf
    for _ in range(CANDIDATES):
        chosen = rng.random(len(tiles)) < plan.test_share
        error = share @ chosen - plan.test_share
        cost = float(np.sum(weight * error * error))
        if cost < best_cost:
            best, best_cost = chosen, cost
    return frozenset(t for t, take in zip(tiles, best, strict=True) if take)


def extents(rows: Sequence[PoolRow]) -> np.ndarray:
    """Each map's extent as a box, (n,) shapely polygons in the common frame."""
    e, n = np.array([r.east for r in rows]), np.array([r.north for r in rows])
    w, h = np.array([r.half_w for r in rows]), np.array([r.half_h for r in rows])
    return np.asarray(shapely.box(e - w, n - h, e + w, n + h))


def split_pool(rows: Sequence[PoolRow], plan: SplitPlan) -> dict[str, str]:
    """map_id -> test | holdout | dev | train | buffer (near a map of another split, in none)."""
    test_tiles, boxes, first = choose_test_tiles(rows, plan), extents(rows), _first_of_ring(rows)

    def among(tiles: frozenset[Tile]) -> np.ndarray:
        return np.array([tile_of(rows[k], plan.tile_m) in tiles for k in first])

    split = np.where(among(test_tiles), "test", plan.rest).astype(object)
    split[(split == plan.rest) & _near(boxes, split == "test")] = BUFFER
    holdout = among(plan.holdout)
    split[_near(boxes, holdout)] = BUFFER
    split[holdout] = "holdout"
    dev = (split == "train") & among(plan.dev)
    split[(split == "train") & _near(boxes, dev)] = BUFFER
    split[dev] = "dev"
    return {row.map_id: name for row, name in zip(rows, split.tolist(), strict=True)}


def _first_of_ring(rows: Sequence[PoolRow]) -> list[int]:
    """Of each map the first of its place: all entry arms of one ring are one."""
    first: dict[tuple[str, ...], int] = {}
    return [
        first.setdefault((r.source, *(r.junction_ids if r.family == "roundabout" else (r.map_id,))), i)
        for i, r in enumerate(rows)
    ]


def _near(boxes: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """(n,) Is a map within 300 m of one of the chosen, or one of these?"""
    near = np.zeros(len(boxes), dtype=bool)
    near[shapely.STRtree(boxes[chosen]).query(boxes, predicate="dwithin", distance=APART_M)[0]] = True
    return near


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
