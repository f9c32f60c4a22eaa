"""The parsed source network and its cache."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from town import EAST, NORTH, make_town

from tsbench.core.errors import InputError
from tsbench.make.city import list_extracts
from tsbench.make.maps.source import SourceNetwork, load_source
from tsbench.scenarios.data_set import DataSet


def test_nodes_stand_where_the_town_put_them(tiny: SourceNetwork) -> None:
    row = tiny.node_ids.index(str(make_town().node(300, 130)))
    assert tiny.node_xy[row].tolist() == pytest.approx([EAST + 300, NORTH + 130], abs=0.05)


def test_opposite_is_an_involution_along_one_line(tiny: SourceNetwork) -> None:
    for row, other in enumerate(tiny.opposite.tolist()):
        if other >= 0:
            assert tiny.opposite[other] == row
            assert tiny.tail[row] == tiny.head[other]
            assert np.allclose(tiny.line(row), tiny.line(other)[::-1], atol=0.5)


def test_types_speeds_and_lanes(tiny: SourceNetwork) -> None:
    by_class = {name: row for row, name in enumerate(tiny.road_class)}
    assert tiny.speed[by_class["residential"]] == pytest.approx(11.11)
    assert tiny.speed[by_class["primary"]] == pytest.approx(16.67)
    assert tiny.lanes[by_class["secondary"]] in (1, 2)
    assert tiny.lanes[by_class["primary"]] == 3
    assert ((tiny.width >= 2.75) & (tiny.width <= 4.5)).all()


def test_the_cache_gives_the_same_network(tiny: SourceNetwork, osm_dir: Path) -> None:
    again = load_source(DataSet(), "tiny", osm_dir)
    assert again.edge_ids == tiny.edge_ids
    assert np.array_equal(again.points, tiny.points)
    assert again.rings == tiny.rings
    assert np.array_equal(again.signals, tiny.signals)


def test_a_missing_extract_says_which_command_gets_it(osm_dir: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no extract 'paris'.*maps fetch"):
        load_source(DataSet(), "paris", osm_dir)
    with pytest.raises(InputError, match="no OSM extract in it"):
        list_extracts(DataSet(), tmp_path)
    with pytest.raises(InputError, match="no such folder"):
        list_extracts(DataSet(), tmp_path / "nowhere")
