"""The committed tables and scene files are complete, sound, and split by place."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np
import pytest
from simworld import simulation

from tsbench.maps.paths import pool_file
from tsbench.maps.pool import PoolRow, read_pool
from tsbench.scenarios.build import APART_M, TEST_PER_TRAIN, stratum_of
from tsbench.scenarios.load import SceneLoader
from tsbench.scenarios.recipe import load_recipe
from tsbench.scenarios.seeds import seed_of
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.split import split_pool
from tsbench.scenarios.table import SPLITS, read_table, table_path
from tsbench.scenarios.variants import variants_of
from tsbench.scenarios.verify import verify_rows, verify_split
from tsbench.signs.catalog import load_catalog
from tsbench.sim.ego import Motion

TYPES = ("detour_right", "no_turn_left", "speed_limit", "yield")
MAPS = {"train": 80, "test": 20}
SCENARIOS = Path(__file__).resolve().parents[2] / "scenarios"


@pytest.fixture(scope="module")
def rows() -> list[ScenarioSpec]:
    return [r for split in SPLITS for r in read_table(table_path(split, SCENARIOS))]


@pytest.fixture(scope="module")
def pool() -> dict[str, PoolRow]:
    return {r.map_id: r for r in read_pool(pool_file())}


def test_four_types_a_hundred_maps_ten_variants(rows: list[ScenarioSpec]) -> None:
    assert len(rows) == len({r.scenario_id for r in rows}) == 4000
    variants: dict[tuple[str, str, str], list[int]] = defaultdict(list)
    for r in rows:
        variants[(r.scenario_type, r.split, r.map_id)].append(r.variant)
    assert all(sorted(v) == list(range(10)) for v in variants.values())
    assert Counter(key[:2] for key in variants) == {(t, s): n for t in TYPES for s, n in MAPS.items()}
    for split in SPLITS:
        assert {r.split for r in read_table(table_path(split, SCENARIOS))} == {split}


def test_every_row_is_what_its_name_makes_it(rows: list[ScenarioSpec]) -> None:
    catalog = load_catalog()
    for r in rows:
        kind = catalog.type(r.scenario_type)
        assert r.scenario_id == f"{r.scenario_type}-{r.map_id}-v{r.variant}"
        assert r.seed == seed_of("scenario", r.scenario_id)
        assert (r.group, r.family, r.horizon) == (kind.group, kind.family, 600)
        assert r.sign_code in kind.codes
        variant = variants_of(r.scenario_type, r.map_id)[r.variant]
        assert (r.density, r.drivers, r.layout) == (variant.density, variant.drivers, variant.layout)
        assert 0.0 < r.initial_speed <= 22.2
        assert r.route_length > 0.0


def test_no_place_is_in_both_splits(rows: list[ScenarioSpec]) -> None:
    assert verify_split(rows) == []


def test_the_split_is_that_of_the_pool(rows: list[ScenarioSpec], pool: dict[str, PoolRow]) -> None:
    split = split_pool(list(pool.values()))
    assert {r.map_id: r.split for r in rows}.items() <= split.items()
    share = Counter(split.values())
    assert share["test"] / (share["test"] + share["train"]) == pytest.approx(0.2, abs=0.05)


@pytest.mark.parametrize("type_id", TYPES)
def test_every_stratum(rows: list[ScenarioSpec], pool: dict[str, PoolRow], type_id: str) -> None:
    """Quotas are met, but for what the build says it missed; no two maps of a type are one place."""
    quota = load_recipe(type_id, load_catalog()).maps
    entries = json.loads((SCENARIOS / "build_report.json").read_text(encoding="utf-8"))
    report = {e["split"]: e for e in entries if e["type_id"] == type_id}
    for split, share in (("train", 1), ("test", TEST_PER_TRAIN)):
        maps = sorted({r.map_id for r in rows if (r.scenario_type, r.split) == (type_id, split)})
        counts = Counter(stratum_of(pool[m]) for m in maps)
        missed = report[split]["missed"]
        assert set(counts) <= set(quota)
        for stratum, wanted in quota.items():
            assert counts[stratum] >= wanted // share - missed.get(stratum, 0)
        assert sum(missed.values()) <= sum(quota.values()) // share // 5
        at = np.array([(pool[m].east, pool[m].north) for m in maps])
        gaps = np.hypot(*(at[:, None] - at[None]).transpose(2, 0, 1)) + np.eye(len(at)) * 1e9
        assert gaps.min() > APART_M


def test_posted_limits_in_about_equal_shares(rows: list[ScenarioSpec]) -> None:
    values = {r.map_id: r.sign_value for r in rows if r.scenario_type == "speed_limit"}
    counts = Counter(values.values())
    assert set(counts) == {20.0, 30.0, 40.0}
    assert min(counts.values()) >= 20


def test_realised_density(rows: list[ScenarioSpec]) -> None:
    """Cars per lane-km within a quarter of what was asked, in every scene with traffic; unbiased on the whole."""
    density = json.loads((SCENARIOS / "build_report.json").read_text(encoding="utf-8"))["density"]
    ratios = np.array([density[r.scenario_id] / (r.density / 0.3) for r in rows if r.density > 0])
    assert len(ratios) == 3600
    assert np.abs(ratios - 1.0).max() <= 0.25 + 1e-3
    assert abs(float(ratios.mean()) - 1.0) < 0.07


def test_every_file_is_there_and_no_other(rows: list[ScenarioSpec]) -> None:
    named = {f for r in rows for f in (r.net, r.additional)}
    there = {p.relative_to(SCENARIOS).as_posix() for p in (SCENARIOS / "scenes").rglob("*") if p.is_file()}
    assert named == there
    assert len(named) == 4400


def sample(rows: list[ScenarioSpec]) -> list[ScenarioSpec]:
    """Every ninety-seventh row: all types, variants and splits are in it."""
    chosen = sorted(rows, key=lambda r: r.scenario_id)[::97]
    assert {r.scenario_type for r in chosen} == set(TYPES)
    assert len({r.variant for r in chosen}) == 10
    return chosen


def test_a_sample_has_the_right_hashes_and_is_sound(rows: list[ScenarioSpec]) -> None:
    assert verify_rows(sample(rows), SCENARIOS, lambda _: None) == []


@pytest.mark.parametrize("type_id", TYPES)
def test_a_busy_scene_runs_in_sumo(rows: list[ScenarioSpec], type_id: str) -> None:
    spec = next(r for r in rows if (r.scenario_type, r.split, r.density) == (type_id, "test", 5.5))
    scene, roads = SceneLoader(SCENARIOS).load(spec)
    lane = roads.network.lane(scene.start.lane)
    x, y = lane.line.point_at(scene.start.s)
    motion = Motion(x, y, lane.line.heading_at(scene.start.s), scene.start.speed)
    sim = simulation()
    sim.load(scene.net_path, scene.additional_path, scene.network, scene.seed)
    sim.start_ego(motion, lane.edge, lane.order)
    sim.step()
    actors = sim.actors()
    assert actors is not None
    assert len(actors) >= 1
    if scene.convoy is not None:
        assert set(scene.convoy.vehicles) <= set(actors.table.ids)
    # Nobody is near the ego when the episode begins.
    ahead = np.hypot(actors.pose[:, 0] - x, actors.pose[:, 1] - y)
    assert float(ahead.min()) > 2.5
