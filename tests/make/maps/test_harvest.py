"""The whole harvest on small extracts: the same bytes again, resumed, and no place twice."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from town import Town, make_town

from tsbench.core.errors import InputError
from tsbench.core.files import sha256_of
from tsbench.make.city import build_dir
from tsbench.make.maps.crop import REGISTRY
from tsbench.make.maps.harvest import Coverage, harvest
from tsbench.make.maps.map_sheet import map_sheet
from tsbench.make.maps.source import SourceNetwork, load_source
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.map_pool import POOL_SCHEMA, map_id, read_pool, write_pool


def shifted(metres: float) -> Town:
    """The same streets with other ids, some metres off, as a generalised extract has them."""
    town, other = make_town(), Town()
    places = {number: place for place, number in town.nodes.items()}
    for refs, tags in town.ways:
        other.road([(places[ref][0] + metres, places[ref][1]) for ref in refs], tags.pop("highway"), **tags)
    other.nodes = {place: number + 50_000 for place, number in other.nodes.items()}
    other.ways = [([ref + 50_000 for ref in refs], tags) for refs, tags in other.ways]
    return other


def silent(what: str, done: int, total: int) -> None:
    assert 0 <= done <= total, what


@pytest.mark.slow
def test_harvest_is_deterministic_resumable_and_finds_no_place_twice(workplace: Path, tmp_path: Path) -> None:
    folder = tmp_path / "osm"
    folder.mkdir()
    (folder / "tiny.osm").write_text(make_town().xml(), encoding="utf-8")
    (folder / "moscow-city-generalised.osm").write_text(shifted(15.0).xml(), encoding="utf-8")
    first = harvest(DataSet(), folder, tmp_path / "pool.parquet", tmp_path / "harvest.json", 2, silent)
    data = (tmp_path / "pool.parquet").read_bytes()
    assert {row.source for row in first.rows} == {"tiny"}
    assert {row.family for row in first.rows} == set(REGISTRY)
    refused = first.rejected["moscow-city-generalised"]
    assert refused["junction: a better-tagged extract has the place"] == 16  # its signal is not in the copy
    assert refused["roundabout: a better-tagged extract has the place"] == 12
    steps = sorted((build_dir() / "harvest").rglob("lint-*.json"))
    assert steps
    steps[0].unlink()  # as if killed before the last step
    again = harvest(DataSet(), folder, tmp_path / "pool.parquet", tmp_path / "harvest.json", 1, silent)
    assert again.rows == first.rows
    assert (tmp_path / "pool.parquet").read_bytes() == data
    report = json.loads((tmp_path / "harvest.json").read_text())
    assert report["maps"] == len(first.rows)
    assert report["rings"] == 1
    rings = [row.fields for row in first.rows if row.family == "roundabout"]
    assert [(ring["entry_cut_m"], ring["arm_cut_m"]) for ring in rings] == [(80.0, 80.0)] * 12


def test_a_better_extract_keeps_a_place_only_where_it_has_roads(tiny: SourceNetwork) -> None:
    junction, *_ = REGISTRY["junction"].find(tiny, Counter())
    pieces = REGISTRY["junction"].pieces(tiny, junction.fields)
    assert Coverage([tiny]).holds(tiny, pieces)
    assert not Coverage([]).holds(tiny, pieces)
    far = replace(tiny, points=tiny.points + 5000.0)
    assert not Coverage([far]).holds(tiny, pieces)


def test_map_ids_come_from_the_source_and_its_ids_only() -> None:
    assert map_id("junction", "nwm", "1", "2") == map_id("junction", "nwm", "1", "2")
    assert map_id("junction", "nwm", "1", "2") != map_id("junction", "nwm", "12")
    assert map_id("junction", "nwm", "1").startswith("j-nwm-")


def test_pool_round_trip_whatever_the_order(tiny: SourceNetwork, tmp_path: Path) -> None:
    rows = [row for family in ("junction", "corridor") for row in REGISTRY[family].find(tiny, Counter())]
    write_pool(rows, tmp_path / "a.parquet")
    write_pool(rows[::-1], tmp_path / "b.parquet")
    assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()
    assert read_pool(tmp_path / "a.parquet") == sorted(rows, key=lambda row: row.map_id)


def test_a_bad_pool_is_one_line(tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    with pytest.raises(InputError, match="maps harvest"):
        read_pool(tmp_path / "none.parquet")
    (tmp_path / "cut.parquet").write_bytes(b"PAR1 and no more")
    with pytest.raises(InputError, match="not a readable Parquet table"):
        read_pool(tmp_path / "cut.parquet")
    pq.write_table(POOL_SCHEMA.remove_metadata().empty_table(), tmp_path / "old.parquet")
    with pytest.raises(InputError, match="schema version none"):
        read_pool(tmp_path / "old.parquet")
    short = POOL_SCHEMA.remove(0).with_metadata({"tsbench_schema": "1"}).empty_table()
    pq.write_table(short, tmp_path / "short.parquet")
    with pytest.raises(InputError, match="'map_id' is missing"):
        read_pool(tmp_path / "short.parquet")


def test_an_extract_without_maps_is_said(workplace: Path, tmp_path: Path) -> None:
    town = Town()
    town.road([(0, 0), (60, 0)], "residential")
    (tmp_path / "lane.osm").write_text(town.xml(), encoding="utf-8")
    with pytest.raises(InputError, match="no map found"):
        harvest(DataSet(), tmp_path, tmp_path / "pool.parquet", tmp_path / "harvest.json", 1, silent)
    assert not (tmp_path / "pool.parquet").exists()


def test_an_extract_with_dots_in_its_name_is_harvested_under_it(workplace: Path, tmp_path: Path) -> None:
    file, town = tmp_path / "st.gallen.osm", Town()
    town.road([(0, 0), (800, 0)], "secondary", maxspeed="60")
    file.write_text(town.xml(), encoding="utf-8")
    result = harvest(DataSet(), tmp_path, tmp_path / "pool.parquet", tmp_path / "harvest.json", 1, silent)
    assert {row.source for row in result.rows} == {"st.gallen"}
    assert json.loads((tmp_path / "harvest.json").read_text())["extracts_sha256"] == {"st.gallen": sha256_of(file)}
    assert map_sheet([(result.rows[0], load_source(DataSet(), "st.gallen", tmp_path))]).size
    assert result.notes == ()


def test_networks_are_read_back_by_name(workplace: Path, osm_dir: Path) -> None:
    assert load_source(DataSet(), "tiny", osm_dir).name == "tiny"
