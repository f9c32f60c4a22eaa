"""Extracts: every kind of file gives the same network, every broken one a single clear line."""

from __future__ import annotations

import bz2
import gzip
import shutil
import tempfile
from pathlib import Path

import osmium
import pytest
from command_line import one_line
from data_folder import in_force
from simworld import road_plain
from town import make_town

from tsbench.core.errors import InputError
from tsbench.make.maps.crop import loads_in_sumo
from tsbench.make.maps.netconvert import build_net, convert_extract
from tsbench.make.maps.osm import read_extract
from tsbench.roads.network import read_network
from tsbench.scenarios.data_set import DataSet

XML = make_town().xml()
NO_ROADS = '<?xml version="1.0"?><osm version="0.6"><node id="1" version="1" lat="55.8" lon="37.4"/></osm>'


def spoil(folder: Path, kind: str) -> Path:
    content: dict[str, tuple[str, bytes]] = {
        "empty": ("a.osm", b""),
        "truncated xml": ("b.osm", XML.encode()[:5000]),
        "truncated gzip": ("c.osm.gz", gzip.compress(XML.encode())[:-200]),
        "truncated bzip2": ("d.osm.bz2", bz2.compress(XML.encode())[:-200]),
        "not osm": ("e.osm", b"<html><body/></html>"),
        "no pbf": ("f.osm.pbf", bytes(range(256)) * 20),
        "no roads": ("g.osm", NO_ROADS.encode()),
        "unknown kind": ("h.txt", b"hello"),
    }
    name, data = content[kind]
    (folder / name).write_bytes(data)
    return folder / name


@pytest.mark.parametrize(
    ("kind", "says"),
    [
        ("empty", "empty"),
        ("truncated xml", "not a whole OSM file"),
        ("truncated gzip", "not a whole OSM file"),
        ("truncated bzip2", "not a whole OSM file"),
        ("not osm", "Unknown top-level element"),
        ("no pbf", "not a whole OSM file"),
        ("no roads", "no road for cars"),
        ("unknown kind", "unknown kind of file"),
    ],
)
def test_a_bad_extract_is_one_line_that_names_the_file(tmp_path: Path, kind: str, says: str) -> None:
    path = spoil(tmp_path, kind)
    with one_line(says, match=f"^{path}"):
        read_extract(path, tmp_path / "plain.osm")


def test_missing_extract_and_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_extract(tmp_path / "x.osm", tmp_path / "plain.osm")
    with pytest.raises(InputError, match="not a file"):
        read_extract(tmp_path, tmp_path / "plain.osm")


def test_all_kinds_of_extract_give_the_same_network(workplace: Path, tmp_path: Path) -> None:
    plain = tmp_path / "town.osm"
    plain.write_text(XML, encoding="utf-8")
    (tmp_path / "town.osm.gz").write_bytes(gzip.compress(XML.encode()))
    (tmp_path / "town.osm.bz2").write_bytes(bz2.compress(XML.encode()))
    with osmium.SimpleWriter(str(tmp_path / "town.osm.pbf")) as writer:
        for entity in osmium.FileProcessor(str(plain)):
            writer.add(entity)
    lanes = []
    for name in ("town.osm", "town.osm.gz", "town.osm.bz2", "town.osm.pbf"):
        out = tmp_path / f"{name}.net.xml"
        facts = convert_extract(DataSet(), tmp_path / name, out)
        assert facts.roads == len(make_town().ways)
        assert len(facts.signals) == 1
        lanes.append([(lane.edge, lane.length, lane.width) for lane in read_network(out).lanes if not lane.internal])
    assert lanes[0] == lanes[1] == lanes[2] == lanes[3]
    assert len(lanes[0]) > 60


def test_the_network_must_be_called_a_network(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.net\.xml"):
        convert_extract(DataSet(), spoil(tmp_path, "no roads"), tmp_path / "out.xml")


@pytest.mark.parametrize("odd", ["a, b", "a b", "a,b", "ä;b"])
def test_paths_that_netconvert_would_split(odd: str, workplace: Path, tmp_path: Path) -> None:
    """The extract, the network, the data folder and the folder of temporary files."""
    folder = tmp_path / odd
    folder.mkdir()
    shutil.copytree(workplace, folder / "data")
    (folder / f"{odd}.osm").write_text(XML, encoding="utf-8")
    out, crop = folder / "made" / f"{odd}.net.xml.gz", folder / "crop.net.xml.gz"
    with in_force(folder / "data") as patch:
        patch.setattr(tempfile, "tempdir", str(folder))
        convert_extract(DataSet(), folder / f"{odd}.osm", out)
        assert len(read_network(out).lanes) > 60
        assert sorted(path.name for path in folder.iterdir()) == sorted(["data", "made", f"{odd}.osm"])
        build_net(road_plain(), crop)
        assert loads_in_sumo(crop)
