"""The split of the whole pool by place, before any sign is assigned.

Source: docs/spec/scenes.md, "Split". Moscow is cut into square tiles of 2 km (a common metric frame for all extracts);
a fifth of the tiles is test. A map whose extent comes within 300 m of a test map's without being one itself belongs to
neither split, so that no place, road or junction is in both, whatever extract it was cut from.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence

import numpy as np
import shapely

from tsbench.core.seeds import ROOT_SEED
from tsbench.scenarios.map_pool import PoolRow

TILE_M = 2000.0
APART_M = 300.0
TEST_SHARE = 0.2
CANDIDATES = 400

Tile = tuple[int, int]


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
    """map_id -> train | test | buffer (near test, in neither split)."""
    test_tiles = choose_test_tiles(rows)
    is_test = np.array([tile_of(r) in test_tiles for r in rows])
    # All entry arms of one ring are one place.
    rings: dict[tuple[str, ...], list[int]] = defaultdict(list)
    for i, row in enumerate(rows):
        if row.family == "roundabout":
            rings[(row.source, *row.junction_ids)].append(i)
    for members in rings.values():
        is_test[members] = is_test[members[0]]
    boxes = extents(rows)
    test_index = np.nonzero(is_test)[0]
    tree = shapely.STRtree(boxes[test_index])
    near = np.zeros(len(rows), dtype=bool)
    near[np.unique(tree.query(boxes, predicate="dwithin", distance=APART_M)[0])] = True
    return {
        row.map_id: "test" if is_test[i] else "buffer" if near[i] else "train" for i, row in enumerate(rows)
    }
