"""The split: no place is in both."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from episode_builders import spec
from hypothesis import given, settings
from hypothesis import strategies as st
from pool_builders import row

from tsbench.make.city import SplitPlan, load_city
from tsbench.make.scenes import split as split_module
from tsbench.make.scenes.split import choose_test_tiles, places_of, split_pool, tile_of, with_places
from tsbench.scenarios.map_pool import PoolRow

PLAN = load_city("moscow").split


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
        family, shape = [("junction", "T"), ("corridor", "straight"), ("dual_path", "X"), ("roundabout", "ring")][
            int(rng.integers(4))
        ]
        if family == "roundabout":
            arms = rng.uniform(-250.0, 250.0, (int(rng.integers(1, 6)), 2))
            rows += [
                row(f"r-{k}-{i}", family, shape, east=east + dx, north=north + dy, half=half, junctions=(f"ring{k}",))
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


SPLITS = {"train", "dev", "holdout", "test"}


@given(pools())
def test_maps_of_different_splits_are_three_hundred_metres_apart(rows: list[PoolRow]) -> None:
    split = split_pool(rows, PLAN)
    assert set(split) == {r.map_id for r in rows}
    assert set(split.values()) <= {*SPLITS, "buffer"}
    for a, b in combinations(rows, 2):
        sides = {split[a.map_id], split[b.map_id]}
        if len(sides) == 2 and "buffer" not in sides:
            assert gap(a, b) >= 300.0 - 1e-6


@given(pools())
def test_no_ring_is_in_two_splits(rows: list[PoolRow]) -> None:
    split = split_pool(rows, PLAN)
    for ring in {r.junction_ids for r in rows if r.family == "roundabout"}:
        assert len({split[r.map_id] for r in rows if r.junction_ids == ring} - {"buffer"}) <= 1


def at(tile: tuple[int, int], name: str, offset: float = 0.0) -> PoolRow:
    """A map of 100 m in the middle of a tile, so many metres further east."""
    east, north = ((k + 0.5) * PLAN.tile_m for k in tile)
    return row(name, "junction", "T", east=east + offset, north=north, half=50.0)


def test_holdout_goes_before_test_and_test_before_dev(monkeypatch: pytest.MonkeyPatch) -> None:
    held, mine = min(PLAN.holdout), min(PLAN.dev)
    rows = [at(held, "a"), at(mine, "b"), at((0, 0), "c"), at((0, 1), "d")]
    monkeypatch.setattr(split_module, "choose_test_tiles", lambda *_: frozenset({held, (0, 0)}))
    assert split_pool(rows, PLAN) == {"a": "holdout", "b": "dev", "c": "test", "d": "train"}
    monkeypatch.setattr(split_module, "choose_test_tiles", lambda *_: frozenset({mine}))
    assert split_pool(rows, PLAN)["b"] == "test"


def test_who_is_near_another_split_is_in_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(split_module, "choose_test_tiles", lambda *_: frozenset({(0, 0)}))
    plan = replace(PLAN, dev=frozenset({(2, 0)}), holdout=frozenset({(4, 0)}))
    # Across the border of a tile, with 299 and 301 m between the extents.
    rows = [at((k, 0), f"{k}{side}", side * 950.0) for k in (0, 2, 4) for side in (-1, 1)]
    for k, gap_m in ((0, 299.0), (2, 301.0), (4, 299.0)):
        rows.append(at((k, 0), f"{k}+", 950.0 + 100.0 + gap_m))
    split = split_pool(rows, plan)
    assert [split[f"{k}+"] for k in (0, 2, 4)] == ["buffer", "train", "buffer"]
    assert {split[f"{k}{side}"] for k in (0, 2, 4) for side in (-1, 1)} == {"test", "dev", "holdout"}


@settings(deadline=None, max_examples=20)
@given(pools(), st.randoms())
def test_the_tiles_do_not_depend_on_the_order_of_the_pool(rows: list[PoolRow], random) -> None:
    shuffled = list(rows)
    random.shuffle(shuffled)
    assert choose_test_tiles(rows, PLAN) == choose_test_tiles(shuffled, PLAN)
    assert split_pool(rows, PLAN) == split_pool(rows, PLAN)


def test_about_a_fifth_of_every_stratum_is_test() -> None:
    rng = np.random.default_rng(3)
    kinds = [("junction", "T"), ("junction", "X"), ("corridor", "straight"), ("corridor", "curved")]
    rows = []
    for k in range(3000):
        family, shape = kinds[k % 4]
        east, north = (float(v) for v in rng.uniform(0.0, 40_000.0, 2))
        rows.append(row(f"m-{k}", family, shape, east=east, north=north))
    split = split_pool(rows, PLAN)
    for family, shape in kinds:
        sides = Counter(split[r.map_id] for r in rows if (r.family, r.shape) == (family, shape))
        assert sides["test"] / 750 == pytest.approx(0.2, abs=0.05)
        assert sides["train"] > 2 * sides["test"]


def test_tiles_are_squares_of_two_kilometres() -> None:
    assert PLAN.tile_m == 2000.0
    assert tile_of(row("a", east=1999.9, north=0.0), PLAN.tile_m) == (0, 0)
    assert tile_of(row("a", east=2000.0, north=-0.1), PLAN.tile_m) == (1, -1)


@settings(deadline=None, max_examples=40)
@given(pools())
def test_a_town_has_dev_where_it_has_no_test_and_never_a_map_in_both(rows: list[PoolRow]) -> None:
    split = split_pool(rows, SplitPlan(1000.0, 0.8))
    assert set(split.values()) <= {"test", "dev", "buffer"}
    for a, b in combinations(rows, 2):
        if {split[a.map_id], split[b.map_id]} == {"test", "dev"}:
            assert gap(a, b) >= 300.0 - 1e-6


def apart(*maps: PoolRow) -> list[PoolRow]:
    """The same maps, each on an OSM way of its own."""
    return [replace(m, osm_ids=(k,)) for k, m in enumerate(maps)]


def test_maps_within_three_hundred_metres_are_one_place_and_what_they_join() -> None:
    near = [row(name, east=east, half=50.0) for name, east in (("a", 0.0), ("b", 400.0), ("c", 801.0), ("d", 1202.0))]
    assert places_of(apart(*near)) == {"a": "a", "b": "a", "c": "c", "d": "d"}
    assert set(places_of(apart(*near, row("ab", east=600.0, half=50.0))).values()) == {"a", "d"}
    assert places_of([]) == {}


def test_maps_of_one_ring_or_one_way_are_one_place_however_far_apart() -> None:
    far = [row(f"r-{k}", "roundabout", "ring", east=5000.0 * k, junctions=("ring",)) for k in range(2)]
    assert set(places_of(apart(*far)).values()) == {"r-0"}
    assert set(places_of(apart(far[0], replace(far[1], source="another"))).values()) == {"r-0", "r-1"}
    way = [replace(row(f"c-{k}", east=5000.0 * k), osm_ids=(7, k)) for k in range(2)]
    assert set(places_of(way).values()) == {"c-0"}


def test_rows_get_the_place_of_their_map_among_the_maps_of_their_table() -> None:
    maps = apart(*(row(name, east=east, half=50.0) for name, east in (("a", 0.0), ("b", 400.0), ("c", 800.0))))
    rows = [replace(spec(name), map_id=name) for name in ("a", "c", "gone")]
    assert [r.place for r in with_places(rows, maps)] == ["a", "c", ""]


@settings(deadline=None, max_examples=30)
@given(pools())
def test_roundabouts_have_no_say_in_the_choice_of_tiles(rows: list[PoolRow]) -> None:
    others = [r for r in rows if r.family != "roundabout"]
    if others:
        assert choose_test_tiles(rows, PLAN) == choose_test_tiles(others, PLAN)
