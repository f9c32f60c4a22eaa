"""The committed tables and scene files are complete, sound, and split by place."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np
import pytest
from simworld import simulation

from tsbench.core.benchmark import TEST_PER_TRAIN
from tsbench.scenarios.map_pool import pool_file
from tsbench.scenarios.map_pool import PoolRow, read_pool
from tsbench.dataset.scenes.build import APART_M, stratum_of
from tsbench.scenarios.certificates import Certificate, certificates_path, read_certificates
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.dataset.scenes.recipe import load_recipe
from tsbench.core.seeds import seed_of
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.dataset.scenes.split import split_pool
from tsbench.scenarios.store import SceneStore, store_path
from tsbench.scenarios.table import SPLITS, read_table, table_path
from tsbench.dataset.scenes.variants import variants_of
from tsbench.dataset.scenes.verify import verify_rows, verify_split
from tsbench.signs.catalog import load_catalog
from tsbench.sim.ego import Motion

TYPES = tuple(t.id for t in load_catalog().types)
MAPS = {"train": 80, "test": 20}
SCENARIOS = Path(__file__).resolve().parents[2] / "scenarios"


@pytest.fixture(scope="module")
def rows() -> list[ScenarioSpec]:
    return [r for split in SPLITS for r in read_table(table_path(split, SCENARIOS))]


@pytest.fixture(scope="module")
def proofs() -> dict[str, Certificate]:
    return {c.scenario_id: c for c in read_certificates(certificates_path(SCENARIOS))}


@pytest.fixture(scope="module")
def pool() -> dict[str, PoolRow]:
    return {r.map_id: r for r in read_pool(pool_file())}


def test_every_type_its_maps_ten_variants(rows: list[ScenarioSpec]) -> None:
    """Test is whole; a type is in train with all its maps or not yet."""
    assert len(rows) == len({r.scenario_id for r in rows})
    variants: dict[tuple[str, str, str], list[int]] = defaultdict(list)
    for r in rows:
        variants[(r.scenario_type, r.split, r.map_id)].append(r.variant)
    assert all(sorted(v) == list(range(10)) for v in variants.values())
    maps = Counter(key[:2] for key in variants)
    assert {t: maps[t, "test"] for t in TYPES} == dict.fromkeys(TYPES, MAPS["test"])
    assert {t: n for (t, s), n in maps.items() if s == "train" and n != MAPS["train"]} == {}
    for split in SPLITS:
        assert {r.split for r in read_table(table_path(split, SCENARIOS))} == {split}


def test_every_row_has_its_certificate(rows: list[ScenarioSpec], proofs: dict[str, Certificate]) -> None:
    """Solvable and sane without exception; nine of ten rows of a type tempt; the rule binds nearly everywhere."""
    assert set(proofs) == {r.scenario_id for r in rows}
    for r in rows:
        c = proofs[r.scenario_id]
        assert (c.solvable, c.sane, c.scenario_type, c.split) == (True, True, r.scenario_type, r.split), c
        assert c.reproduced is not False, c
    for type_id in TYPES:
        own = [c for c in proofs.values() if c.scenario_type == type_id]
        assert sum(c.tempting for c in own) >= 0.9 * len(own)
        assert sum(c.engaged for c in own) >= 0.95 * len(own)


def test_every_row_is_what_its_name_makes_it(
    rows: list[ScenarioSpec], proofs: dict[str, Certificate]
) -> None:
    catalog = load_catalog()
    for r in rows:
        kind = catalog.type(r.scenario_type)
        assert r.scenario_id == f"{r.scenario_type}-{r.map_id}-v{r.variant}"
        assert r.seed == seed_of("scenario", f"{r.scenario_id}~{proofs[r.scenario_id].attempt}")
        assert (r.group, r.family) == (kind.group, kind.family)
        assert r.horizon == (1000 if r.family == "roundabout" else 600)
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
    apart = load_recipe(type_id, load_catalog()).numbers.get("apart_m", APART_M)
    for split, share in (("train", 1), ("test", TEST_PER_TRAIN)):
        maps = sorted({r.map_id for r in rows if (r.scenario_type, r.split) == (type_id, split)})
        if not maps:
            continue
        counts = Counter(stratum_of(pool[m]) for m in maps)
        missed = report[split]["missed"]
        assert report[split]["short"] == 0
        assert set(counts) <= set(quota)
        for stratum, wanted in quota.items():
            assert counts[stratum] >= wanted // share - missed.get(stratum, 0)
        at = np.array([(pool[m].east, pool[m].north) for m in maps])
        gaps = np.hypot(*(at[:, None] - at[None]).transpose(2, 0, 1)) + np.eye(len(at)) * 1e9
        assert gaps.min() >= apart


def test_posted_limits_in_about_equal_shares(rows: list[ScenarioSpec]) -> None:
    values = {r.map_id: r.sign_value for r in rows if r.scenario_type == "speed_limit"}
    counts = Counter(values.values())
    assert set(counts) == {20.0, 30.0, 40.0}
    assert min(counts.values()) >= 0.2 * len(values)


def test_realised_density(rows: list[ScenarioSpec], proofs: dict[str, Certificate]) -> None:
    """Cars per lane-km within a quarter of what was asked, in every scene with traffic; unbiased on the whole."""
    dense = [proofs[r.scenario_id] for r in rows if r.density > 0]
    ratios = np.array([c.realised_density / c.asked_density for c in dense])
    assert len(ratios) == 9 * len({(r.scenario_type, r.map_id) for r in rows})
    assert np.abs(ratios - 1.0).max() <= 0.25 + 1e-3
    assert abs(float(ratios.mean()) - 1.0) < 0.07


def test_every_file_is_there_and_no_other(rows: list[ScenarioSpec]) -> None:
    named: dict[Path, dict[str, str]] = defaultdict(dict)
    for r in rows:
        named[store_path(r.split, r.scenario_type)] |= {r.net: r.net_sha256, r.additional: r.additional_sha256}
    assert {p for p in (SCENARIOS / "scenes").rglob("*") if p.is_file()} == set(named)
    store = SceneStore()
    for path, files in named.items():
        assert store.names(path.parent.name, path.stem) == files


def sample(rows: list[ScenarioSpec]) -> list[ScenarioSpec]:
    """Every 97th row: all types and variants are in it."""
    chosen = sorted(rows, key=lambda r: r.scenario_id)[::97]
    assert {r.scenario_type for r in chosen} == set(TYPES)
    assert len({r.variant for r in chosen}) == 10
    return chosen


def test_a_sample_has_the_right_hashes_and_is_sound(rows: list[ScenarioSpec]) -> None:
    assert verify_rows(sample(rows), SceneLoader(), lambda _: None) == []


@pytest.mark.parametrize("type_id", TYPES)
def test_a_busy_scene_runs_in_sumo(rows: list[ScenarioSpec], type_id: str) -> None:
    spec = next(r for r in rows if (r.scenario_type, r.split, r.density) == (type_id, "test", 5.5))
    scene, roads = SceneLoader().load(spec)
    lane = roads.network.lane(scene.start.lane)
    x, y = lane.line.point_at(scene.start.s)
    motion = Motion(x, y, lane.line.heading_at(scene.start.s), scene.start.speed)
    sim = simulation()
    sim.load_scene(scene)
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
