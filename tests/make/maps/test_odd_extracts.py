"""An extract that nobody prepared ends in a source network in its right place, or in one line that says why not."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from command_line import one_line
from odd_extracts import BUILT, REFUSED, SOUTH, grid
from town import EAST

from tsbench.make.city import types_file
from tsbench.make.maps.plain import class_speeds
from tsbench.make.maps.source import SourceNetwork, load_source
from tsbench.scenarios.data_set import DataSet


def source_of(folder: Path, file: str, content: bytes) -> SourceNetwork:
    (folder / file).write_bytes(content)
    return load_source(DataSet(), file.split(".", 1)[0], folder)


@pytest.mark.parametrize("file", sorted(set(REFUSED) - {"motorway.osm"}))
@pytest.mark.usefixtures("workplace")
def test_what_is_no_city_is_refused_in_one_line(file: str, tmp_path: Path) -> None:
    make, says = REFUSED[file]
    with one_line(file, match=re.escape(says)):
        source_of(tmp_path, file, make())


@pytest.mark.usefixtures("workplace")
def test_a_town_below_the_equator_lies_there(tmp_path: Path) -> None:
    source = source_of(tmp_path, "southern.osm", BUILT["southern.osm"]())
    lat, lon = source.frame.to_degrees(*source.signals[0]).tolist()
    assert (round(lat, 2), round(lon, 2)) == (-33.89, 8.03)
    # Counted from 10,000 km below the equator or from the equator, metres are metres.
    assert np.ptp(source.node_xy[:, 0]) == pytest.approx(600.0, abs=1.0)
    assert source.signals[0] == pytest.approx([EAST + 150.0, SOUTH + 130.0 - 1e7], abs=0.1)


@pytest.mark.usefixtures("workplace")
def test_a_town_across_a_zones_edge_is_in_one_frame(tmp_path: Path) -> None:
    source = source_of(tmp_path, "edge.osm", BUILT["edge.osm"]())
    lon = source.frame.to_degrees(*source.node_xy.T)[:, 1]
    assert lon.min() < 12.0 < lon.max()
    assert np.ptp(source.node_xy[:, 0]) == pytest.approx(600.0, abs=1.0)


@pytest.mark.usefixtures("workplace")
def test_tags_that_mean_nothing_are_not_believed(tmp_path: Path) -> None:
    source = source_of(tmp_path, "nonsense.osm", BUILT["nonsense.osm"]())
    assert source.speed.max() < 30.0
    assert source.speed.min() > 1.0
    assert set(source.lanes.tolist()) <= {1, 2, 3, 4}
    assert source.width.min() >= 2.75
    wrong = source.speed[[511 - 6 in ids for ids in source.osm_ids]]
    assert len(wrong)
    assert wrong == pytest.approx(class_speeds(types_file(DataSet()))["highway.tertiary"])  # tagged 999999


@pytest.mark.usefixtures("workplace")
def test_a_town_with_a_node_at_null_is_as_wide_as_it_is(tmp_path: Path) -> None:
    source = source_of(tmp_path, "null.osm", BUILT["null.osm"]())
    assert np.ptp(source.node_xy, axis=0).tolist() == pytest.approx([600.0, 2090.0], abs=5.0)
    assert source.notes[0] == "left out what lies at 0, 0 degrees, where no road is: node 1001"


@pytest.mark.usefixtures("workplace")
def test_five_hundred_junctions_are_read(tmp_path: Path) -> None:
    assert len(source_of(tmp_path, "grid.osm", grid()).node_ids) == 500
