"""The split of the whole pool by place, before any sign is assigned.

Source: docs/spec/scenes.md, "Split". Moscow is cut into square tiles of 2 km (a common metric frame for all extracts);
a fifth of the tiles is test. One district is holdout, of which nothing is ever learned, and a few tiles of what would
be train are dev. A map whose extent comes within 300 m of another split's without being one of it belongs to none, so
that no place, road or junction is in two, whatever extract it was cut from.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

import numpy as np
import shapely

from tsbench.core.seeds import ROOT_SEED
from tsbench.scenarios.map_pool import PoolRow

TILE_M = 2000.0
APART_M = 300.0
TEST_SHARE = 0.2
CANDIDATES = 400
BUFFER = "buffer"

Tile = tuple[int, int]

# The south-east around Kuzminki, 8 km by 8 km: maps for all types are there, and hardly one was in use before.
HOLDOUT_TILES = frozenset(product(range(211, 215), range(3084, 3088)))
# Together they have many maps for every type, and few that were in use before.
DEV_TILES = frozenset(
    {(192, 3076), (195, 3082), (197, 3072), (201, 3085), (208, 3088), (208, 3091), (210, 3091)}
)


def tile_of(row: PoolRow) -> Tile:
    """The tile that holds the middle of a map."""
    return math.floor(row.east / TILE_M), math.floor(row.north / TILE_M)


def _stratum(row: PoolRow) -> str:
    lanes = str(row.lane_bucket) if row.family == "corridor" else ""
    return f"{row.family}/{row.shape}/{row.slot}/{lanes}/{'tagged' if row.well_tagged else 'plain'}"


def choose_test_tiles(rows: Sequence[PoolRow]) -> frozenset[Tile]:
    """The tiles of the test split: of 400 seeded draws, the one closest to a fifth in every stratum.

    Strata: family, shape, slot, lane bucket, tagging. Roundabouts have no say: one ring is many maps of one place.
    """
    rows = [r for r in rows if r.family != "roundabout"] or rows
    tiles = sorted({tile_of(r) for r in rows})
    column = {t: i for i, t in enumerate(tiles)}
    strata = {name: i for i, name in enumerate(sorted({_stratum(r) for r in rows}))}
    counts = np.zeros((len(strata), len(tiles)))
    for row in rows:
        counts[strata[_stratum(row)], column[tile_of(row)]] += 1
    share = counts / counts.sum(axis=1, keepdims=True)
    weight = np.sqrt(counts.sum(axis=1))
    rng = np.random.default_rng(np.random.SeedSequence([ROOT_SEED, 0x5917]))
    best, best_cost = np.zeros(len(tiles), dtype=bool), math.inf
    for _ in range(CANDIDATES):
        chosen = rng.random(len(tiles)) < TEST_SHARE
        error = share @ chosen - TEST_SHARE
        cost = float(np.sum(weight * error * error))
        if cost < best_cost:
            best, best_cost = chosen, cost
    return frozenset(t for t, take in zip(tiles, best, strict=True) if take)


def extents(rows: Sequence[PoolRow]) -> np.ndarray:
    """Each map's extent as a box, (n,) shapely polygons in the common frame."""
    e, n = np.array([r.east for r in rows]), np.array([r.north for r in rows])
    w, h = np.array([r.half_w for r in rows]), np.array([r.half_h for r in rows])
    return np.asarray(shapely.box(e - w, n - h, e + w, n + h))


def split_pool(rows: Sequence[PoolRow]) -> dict[str, str]:
    """map_id -> test | holdout | dev | train | buffer (near a map of another split, in none)."""
    test_tiles, boxes, first = choose_test_tiles(rows), extents(rows), _first_of_ring(rows)

    def among(tiles: frozenset[Tile]) -> np.ndarray:
        return np.array([tile_of(rows[k]) in tiles for k in first])

    split = np.where(among(test_tiles), "test", "train").astype(object)
    split[(split == "train") & _near(boxes, split == "test")] = BUFFER
    holdout = among(HOLDOUT_TILES)
    split[_near(boxes, holdout)] = BUFFER
    split[holdout] = "holdout"
    dev = (split == "train") & among(DEV_TILES)
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
