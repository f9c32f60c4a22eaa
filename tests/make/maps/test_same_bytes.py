"""From an extract to maps and scenes anew: what comes with tsbench, to the byte."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tsbench.core.files import sha256_of
from tsbench.make.city import list_extracts, load_city
from tsbench.make.maps.extracts import extract_name
from tsbench.make.maps.harvest import harvest
from tsbench.make.maps.source import load_source
from tsbench.make.scenes.map_scenarios import SiteBuilder
from tsbench.make.scenes.recipe import load_recipe
from tsbench.run.edition import editions
from tsbench.scenarios.data_set import DataSet, read_table, scene_editions
from tsbench.scenarios.map_pool import read_pool
from tsbench.signs.catalog import load_catalog
from tsbench.sim.sumo import Simulation

REPOSITORY = Path(__file__).resolve().parents[3]
SOURCES = REPOSITORY / "sumo_nets" / "sources"
# The extract of the old quarter: small, and Moscow's scenes of this type on it need no second draw.
EXTRACT, TYPE = "ostankino-2013", "yield"


@pytest.fixture(scope="module")
def osm(workplace: Path) -> Path:
    """A folder with this extract alone."""
    folder = workplace / "again"
    folder.mkdir()
    shutil.copy(SOURCES / f"{EXTRACT}.osm.gz", folder)
    return folder


def test_the_extracts_are_those_of_the_city_s_file() -> None:
    told = {e.name: (e.sha256, e.bytes) for e in load_city("moscow").extracts}
    found = {extract_name(path): (sha256_of(path), path.stat().st_size) for path in list_extracts(DataSet(), SOURCES)}
    assert found == told


# The second has most of the roads that are closed to cars.
@pytest.mark.parametrize("extract", [EXTRACT, pytest.param("dolgoprudny", marks=pytest.mark.slow)])
def test_the_extract_gives_the_maps_of_the_pool(extract: str, workplace: Path, tmp_path: Path) -> None:
    shipped = {row.map_id: row for row in read_pool(REPOSITORY / "sumo_nets" / "pool.parquet") if row.source == extract}
    (tmp_path / "osm").mkdir()
    shutil.copy(SOURCES / f"{extract}.osm.gz", tmp_path / "osm")
    pool = tmp_path / "again.parquet"
    harvest(DataSet(), tmp_path / "osm", pool, tmp_path / "again.json", 1, lambda *_: None)
    made = {row.map_id: row for row in read_pool(pool)}
    # Alone, the extract keeps the maps that it leaves to better ones elsewhere.
    assert set(shipped) <= set(made)
    assert [name for name, row in shipped.items() if made[name] != row] == []


def test_maps_give_the_scenes_of_their_edition(osm: Path, workplace: Path, tmp_path: Path) -> None:
    scenarios = REPOSITORY / "scenarios"
    (workplace / "scenarios").mkdir(exist_ok=True)
    shutil.copy(scenarios / "nuplan_statistics.json", workplace / "scenarios")
    rows = read_table(scenarios / "test.parquet")
    pool = {row.map_id: row for row in read_pool(REPOSITORY / "sumo_nets" / "pool.parquet")}
    maps = sorted({r.map_id for r in rows if r.pair_type == TYPE and pool[r.map_id].source == EXTRACT})
    assert maps
    recipe = load_recipe(TYPE, load_catalog(), scenarios / "recipes")
    builder, source = SiteBuilder(recipe, tmp_path, Simulation()), load_source(DataSet(), EXTRACT, osm)
    for one in maps:
        built = builder.build(pool[one], source, "test")
        if scene_editions(scenarios / "editions.yaml")["test"] != editions()[-1].name and built.reason:
            continue  # The rules of a later edition refuse the map.
        assert built.reason == ""
        shipped = {r.scenario_id: r for r in rows if r.map_id == one and r.pair_type == TYPE}
        assert {r.scenario_id for r in built.rows} == set(shipped)
        same = [
            (row.net_sha256, row.additional_sha256, row.seed, row.sign_code, row.sign_value)
            == (one.net_sha256, one.additional_sha256, one.seed, one.sign_code, one.sign_value)
            for row, one in ((row, shipped[row.scenario_id]) for row in built.rows)
        ]
        # Scenes of an earlier edition were drawn by its rules.
        assert all(same) is (scene_editions(scenarios / "editions.yaml")["test"] == editions()[-1].name)
