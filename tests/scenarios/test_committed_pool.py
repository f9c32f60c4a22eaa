"""Every row of the committed pool keeps its family's bounds; the published sizes are reached."""

from __future__ import annotations

import math
from collections import Counter
from itertools import combinations
from pathlib import Path

import pytest

from tsbench.geometry.elementary import wrap_deg
from tsbench.make.maps.stats import count_tables
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.map_pool import SLOTS, PoolRow, read_pool

POOL = Path(__file__).resolve().parents[2] / "sumo_nets" / "pool.parquet"


@pytest.fixture(scope="module")
def pool() -> list[PoolRow]:
    return read_pool(POOL)


def of(pool: list[PoolRow], family: str) -> list[PoolRow]:
    return [row for row in pool if row.family == family]


def test_sizes(pool: list[PoolRow]) -> None:
    kinds = Counter(row.family for row in pool)
    assert kinds["junction"] + kinds["roundabout"] >= 6457
    assert kinds["dual_path"] >= 6507
    assert kinds["corridor"] >= 13056
    assert len(pool) >= 26020
    assert POOL.stat().st_size < 15e6


def test_ids_and_places(pool: list[PoolRow]) -> None:
    assert len({row.map_id for row in pool}) == len(pool)
    for row in pool:
        assert 55.1 < row.lat < 56.1
        assert 36.9 < row.lon < 38.0
        assert row.osm_ids
        assert row.lane_bucket == min(row.lanes, 3) >= 1
        assert 1 < row.speed_mps < 32


def test_junctions(pool: list[PoolRow]) -> None:
    for row in of(pool, "junction"):
        arms = row.fields["arms"]
        assert len(arms) == {"T": 3, "X": 4}[row.shape]
        assert len(row.fields["through"]) == len(arms) - 2
        headings = sorted(arm["heading_deg"] % 360 for arm in arms)
        gaps = [abs(wrap_deg(b - a)) for a, b in zip(headings, [*headings[1:], headings[0]], strict=True)]
        assert min(gaps) >= 39.8
        assert all(40 <= arm["length_m"] <= 80 for arm in arms)
        for i, j in row.fields["through"]:
            assert abs(wrap_deg(arms[i]["heading_deg"] - arms[j]["heading_deg"])) >= 144.8


def test_roundabouts(pool: list[PoolRow]) -> None:
    rings: dict[tuple[str, ...], list[PoolRow]] = {}
    for row in of(pool, "roundabout"):
        detail = row.fields
        rings.setdefault((row.source, *detail["ring"]), []).append(row)
        assert len(detail["entries"]) >= 3
        assert len(detail["exits"]) >= 2
        assert detail["entries"][detail["entry"]]["edges"][-1] == detail["entry_edge"]
        assert detail["exits"][detail["exit"]]["edges"][0] == detail["exit_edge"]
        assert [detail["entry_edge"], detail["exit_edge"]] not in detail["arms"]
        assert 30 <= row.length_m <= 700
    assert len(rings) >= 28
    for rows in rings.values():
        first = [row for row in rows if row.fields["rank"] == 0]
        assert len({row.fields["entry"] for row in first}) == len(first)
    middles = [(rows[0].east, rows[0].north) for rows in rings.values()]
    assert min(math.dist(a, b) for a, b in combinations(middles, 2)) > 80


def test_dual_paths(pool: list[PoolRow]) -> None:
    slots = Counter((row.slot, row.shape) for row in of(pool, "dual_path"))
    assert all(slots[slot, shape] >= 200 for slot in SLOTS for shape in "TX")
    for row in of(pool, "dual_path"):
        detail = row.fields
        assert detail["compliant_m"] - detail["short_m"] >= 19.9
        assert detail["short_m"] <= 350
        assert detail["compliant_m"] <= 700
        assert detail["approach_m"] >= 80
        assert detail["short"][-1] == detail["compliant"][-1] == detail["destination_edge"]


def test_corridors(pool: list[PoolRow]) -> None:
    ways: Counter[tuple[str, int]] = Counter()
    for row in of(pool, "corridor"):
        start, end = row.fields["span"]
        assert 150 <= row.length_m <= 250
        assert end - start == pytest.approx(row.length_m, abs=0.01)
        assert row.curvature >= 0.97
        assert row.shape == ("straight" if row.curvature >= 0.99 else "curved")
        ways.update((row.source, way) for way in row.osm_ids)
    assert max(ways.values()) == 1


def test_well_tagged_extracts_hold_what_the_scenarios_ask(pool: list[PoolRow]) -> None:
    tagged = [row for row in pool if row.well_tagged]
    straight = [row for row in of(tagged, "corridor") if row.shape == "straight"]
    assert Counter(row.shape for row in of(tagged, "junction"))["T"] >= 500
    assert sum(row.lanes >= 2 for row in straight) >= 300
    assert sum(row.lanes >= 3 for row in straight) >= 150
    assert sum(row.lanes >= 2 and row.oneway for row in straight) >= 150


def test_overlapping_extracts_do_not_give_a_junction_twice(pool: list[PoolRow]) -> None:
    cells: dict[tuple[int, int], list[PoolRow]] = {}
    for row in of(pool, "junction"):
        cells.setdefault((int(row.east // 100), int(row.north // 100)), []).append(row)
    for (i, j), rows in cells.items():
        near = [other for di in (0, 1) for dj in (-1, 0, 1) for other in cells.get((i + di, j + dj), ())]
        for row in rows:
            for other in near:
                if other.source != row.source:
                    assert math.hypot(other.east - row.east, other.north - row.north) > 25, (row, other)


def test_stats_add_up(pool: list[PoolRow]) -> None:
    tables = count_tables(DataSet(), pool)
    assert tables[0].rows[-1][1][-1] == len(pool)
    for table in tables:
        for _, numbers in table.rows:
            assert sum(numbers[:-1]) == numbers[-1]
