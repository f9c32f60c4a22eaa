"""The split: no place is in both."""

from __future__ import annotations

import math
from collections import Counter
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pool_builders import row

from tsbench.dataset.scenes.overview import places
from tsbench.dataset.scenes.split import TILE_M, choose_test_tiles, split_pool, tile_of
from tsbench.scenarios.map_pool import PoolRow


@st.composite
def pools(draw: st.DrawFn) -> list[PoolRow]:
    """Maps of all families strewn over a few tiles; rings with up to five arms."""
    rows = []
    side = draw(st.floats(500.0, 12_000.0))
    middle = draw(st.sampled_from([0.0, -3000.0, 407_000.0]))
    n = draw(st.integers(1, 50))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    for k in range(n):
        east, north = (float(v) for v in middle + rng.uniform(0.0, side, 2))
        half = float(rng.uniform(20.0, 450.0))
        family, shape = [
            ("junction", "T"), ("corridor", "straight"), ("dual_path", "X"), ("roundabout", "ring")
        ][int(rng.integers(4))]  # fmt: skip
        if family == "roundabout":
            arms = rng.uniform(-250.0, 250.0, (int(rng.integers(1, 6)), 2))
            rows += [
                row(
                    f"r-{k}-{i}",
                    family,
                    shape,
                    east=east + dx,
                    north=north + dy,
                    half=half,
                    junctions=(f"ring{k}",),
                )
                for i, (dx, dy) in enumerate(arms.tolist())
            ]
        else:
            rows.append(row(f"{family[0]}-{k}", family, shape, east=east, north=north, half=half))
    return rows


def gap(a: PoolRow, b: PoolRow) -> float:
    """Distance between two maps' extents."""
    dx = max(abs(a.east - b.east) - a.half_w - b.half_w, 0.0)
    dy = max(abs(a.north - b.north) - a.half_h - b.half_h, 0.0)
    return math.hypot(dx, dy)


@settings(deadline=None, max_examples=60)
@given(pools())
def test_maps_of_different_splits_are_three_hundred_metres_apart(rows: list[PoolRow]) -> None:
    split = split_pool(rows)
    assert set(split) == {r.map_id for r in rows}
    assert set(split.values()) <= {"train", "test", "buffer"}
    for a, b in combinations(rows, 2):
        if {split[a.map_id], split[b.map_id]} == {"train", "test"}:
            assert gap(a, b) >= 300.0 - 1e-6
    for r in rows:
        if split[r.map_id] == "buffer":
            assert any(split[o.map_id] == "test" and gap(r, o) <= 300.0 + 1e-6 for o in rows)


@settings(deadline=None, max_examples=60)
@given(pools())
def test_no_ring_is_in_both_splits(rows: list[PoolRow]) -> None:
    split = split_pool(rows)
    for ring in {r.junction_ids for r in rows if r.family == "roundabout"}:
        sides = {split[r.map_id] for r in rows if r.junction_ids == ring}
        assert not {"train", "test"} <= sides
        assert "test" not in sides or sides == {"test"}


@settings(deadline=None, max_examples=20)
@given(pools(), st.randoms())
def test_the_tiles_do_not_depend_on_the_order_of_the_pool(rows: list[PoolRow], random) -> None:
    shuffled = list(rows)
    random.shuffle(shuffled)
    assert choose_test_tiles(rows) == choose_test_tiles(shuffled)
    assert split_pool(rows) == split_pool(rows)


def test_about_a_fifth_of_every_stratum_is_test() -> None:
    rng = np.random.default_rng(3)
    kinds = [("junction", "T"), ("junction", "X"), ("corridor", "straight"), ("corridor", "curved")]
    rows = []
    for k in range(3000):
        family, shape = kinds[k % 4]
        east, north = (float(v) for v in rng.uniform(0.0, 40_000.0, 2))
        rows.append(row(f"m-{k}", family, shape, east=east, north=north))
    split = split_pool(rows)
    for family, shape in kinds:
        sides = Counter(split[r.map_id] for r in rows if (r.family, r.shape) == (family, shape))
        assert sides["test"] / 750 == pytest.approx(0.2, abs=0.05)
        assert sides["train"] > 2 * sides["test"]


def test_tiles_are_squares_of_two_kilometres() -> None:
    assert TILE_M == 2000.0
    assert tile_of(row("a", east=1999.9, north=0.0)) == (0, 0)
    assert tile_of(row("a", east=2000.0, north=-0.1)) == (1, -1)


def test_places_are_three_hundred_metres_apart() -> None:
    assert places([]) == 0
    assert places([(0, 0), (299, 0), (598, 0), (301, 0)]) == 2
    assert places([(0, 0), (301, 0), (0, 301)]) == 3


@settings(deadline=None, max_examples=30)
@given(pools())
def test_roundabouts_have_no_say_in_the_choice_of_tiles(rows: list[PoolRow]) -> None:
    others = [r for r in rows if r.family != "roundabout"]
    if others:
        assert choose_test_tiles(rows) == choose_test_tiles(others)
