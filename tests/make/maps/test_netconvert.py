"""What netconvert says and leaves out reaches who converts an extract."""

from __future__ import annotations

from pathlib import Path

import pytest
from town import Town

from tsbench.make.maps.harvest import harvest
from tsbench.make.maps.netconvert import convert_extract
from tsbench.make.maps.source import load_source
from tsbench.scenarios.data_set import DataSet


@pytest.fixture
def town(workplace: Path, tmp_path: Path) -> Path:
    """Two roads for cars, one that is closed to them, one of which no node is there, one with a limit in words."""
    made = Town()
    for row, tags in enumerate(({}, {"maxspeed": "fifty"}, {"access": "no"}, {"maxspeed": "sixty"})):
        made.road([(0, 100.0 * row), (300, 100.0 * row)], "residential", **tags)
    made.ways.append(([7, 8], {"highway": "residential"}))
    (tmp_path / "town.osm").write_text(made.xml(), encoding="utf-8")
    return tmp_path / "town.osm"


SAID = (
    "ways left out, closed to cars: 1 (access=no 1): way 503",
    "netconvert: Value of key 'maxspeed' is not numeric ('fifty') in edge '502'. (and 1 like it)",
    "1 of 4 roads for cars are not in the network, because cars may not use them, their nodes are missing or they are "
    "as short as a junction: way 505",
)


@pytest.mark.parametrize("out", ["town.net.xml", "town.net.xml.gz"])
def test_roads_that_are_lost_are_counted_and_named(out: str, town: Path) -> None:
    facts = convert_extract(DataSet(), town, town.with_name(out))
    assert facts.roads == 4
    assert facts.notes == SAID
    # That coordinates are large is what we asked for.
    assert not any("very large coordinates" in line for line in facts.warnings)


def test_a_source_keeps_the_lines_and_a_harvest_tells_them(town: Path) -> None:
    assert load_source(DataSet(), "town", town.parent).notes == list(SAID)
    assert load_source(DataSet(), "town", town.parent).notes == list(SAID)
    result = harvest(
        DataSet(), town.parent, town.with_name("pool.parquet"), town.with_name("harvest.json"), 1, lambda *_: None
    )
    assert result.notes == tuple(f"{town}: {line}" for line in SAID)


def test_a_road_within_one_junction_is_not_lost(workplace: Path, tmp_path: Path) -> None:
    made = Town()
    for x in (0.0, 12.0):
        made.road([(x, -200), (x, 0), (x, 200)], "primary", oneway="yes" if x else "-1")
    made.road([(0, 0), (12, 0)], "primary")
    made.road([(-200, 0), (0, 0)], "residential")
    made.road([(12, 0), (200, 0)], "residential")
    (tmp_path / "town.osm").write_text(made.xml(), encoding="utf-8")
    source = load_source(DataSet(), "town", tmp_path)
    assert 503 not in {way for ids in source.osm_ids for way in ids}
    assert source.notes == []
