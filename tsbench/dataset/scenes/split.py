"""The split of the whole pool by place, before any sign is assigned.

Source: docs/spec/scenes.md, "Split". Moscow is cut into square tiles of 2 km (a common metric frame for all extracts);
a fifth of the tiles is test, some are dev, and one whole extract is holdout, of which nothing is ever learned. A map
whose extent comes within 300 m of a map of a split that goes before its own belongs to none, so that no place, road or
junction is in two, whatever extract it was cut from.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely

from tsbench.core.seeds import ROOT_SEED
from tsbench.scenarios.map_pool import PoolRow

TILE_M = 2000.0
APART_M = 300.0
TEST_SHARE, DEV_SHARE = 0.2, 0.06
HOLDOUT = "nw-moscow"
CANDIDATES = 400

Tile = tuple[int, int]


def tile_of(row: PoolRow) -> Tile:
    """The tile that holds the middle of a map."""
    return math.floor(row.east / TILE_M), math.floor(row.north / TILE_M)


def _stratum(row: PoolRow) -> str:
    lanes = str(row.lane_bucket) if row.family == "corridor" else ""
    return f"{row.family}/{row.shape}/{row.slot}/{lanes}/{'tagged' if row.well_tagged else 'plain'}"


def choose_tiles(rows: Sequence[PoolRow], wanted: float, key: int) -> frozenset[Tile]:
    """The tiles of a split: of 400 draws seeded by `key`, the one closest to the wanted share in every stratum.

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
    rng = np.random.default_rng(np.random.SeedSequence([ROOT_SEED, key]))
    best, best_cost = np.zeros(len(tiles), dtype=bool), math.inf
    for _ in range(CANDIDATES):
        chosen = rng.random(len(tiles)) < wanted
        error = share @ chosen - wanted
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
    """map_id -> holdout | test | dev | train | buffer (near a map of a split before its own, in none)."""
    test = choose_tiles(rows, TEST_SHARE, 0x5917)
    dev = choose_tiles([r for r in rows if tile_of(r) not in test], DEV_SHARE, 0xDE5)
    split = [
        "holdout"
        if r.source == HOLDOUT
        else "test"
        if tile_of(r) in test
        else "dev"
        if tile_of(r) in dev
        else "train"
        for r in rows
    ]
    # All entry arms of one ring are one place.
    rings: dict[tuple[str, ...], int] = {}
    for i, row in enumerate(rows):
        if row.family == "roundabout":
            split[i] = split[rings.setdefault((row.source, *row.junction_ids), i)]
    boxes, names = extents(rows), np.array(split)
    done: list[str] = []
    for name in ("holdout", "test", "dev"):
        done.append(name)
        tree, later = shapely.STRtree(boxes[names == name]), np.flatnonzero(~np.isin(names, done))
        near = tree.query(boxes[later], predicate="dwithin", distance=APART_M)[0]
        names[later[np.unique(near)]] = "buffer"
    return {row.map_id: str(name) for row, name in zip(rows, names, strict=True)}
