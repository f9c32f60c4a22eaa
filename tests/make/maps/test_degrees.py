"""Places that are none, or far from all others: one line, or a note that says what was left out."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import osmium
import pytest
from click.testing import CliRunner
from town import Town

from tsbench.cli import cli
from tsbench.core.errors import InputError
from tsbench.make import city as cities
from tsbench.make.maps.netconvert import convert_extract
from tsbench.make.maps.osm import read_extract
from tsbench.make.maps.osm_objects import places_of
from tsbench.make.maps.own_extract import facts_of
from tsbench.roads.network import read_network


def xml(lat: str = "55.7", lon: str = "37.5", head: str = "") -> str:
    """A road of three nodes; the place of its first."""
    nodes = [(1, lat, lon), (2, "55.701", "37.5"), (3, "55.702", "37.5")]
    made = "".join(f'<node id="{name}" version="1" lat="{y}" lon="{x}"/>' for name, y, x in nodes)
    refs = "".join(f'<nd ref="{name}"/>' for name, _, _ in nodes)
    way = f'<way id="9" version="1">{refs}<tag k="highway" v="residential"/></way>'
    return f'<osm version="0.6">{head}{made}{way}</osm>'


BAD = ["55,70", "", "nan", "1e400", "-1e400", "inf", "abc", " 55.7", "0x10", "200000", "5.5e"]


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("key", ["lat", "lon"])
@pytest.mark.parametrize("value", BAD)
def test_what_is_no_number_of_degrees_is_one_line(key: str, value: str, packed: bool, tmp_path: Path) -> None:
    path = tmp_path / ("town.osm.gz" if packed else "town.osm")
    text = xml(**{key: value}).encode()
    path.write_bytes(gzip.compress(text) if packed else text)
    for read in (lambda: read_extract(path, tmp_path / "plain.osm"), lambda: facts_of(path, "2022-01-02", None)):
        with pytest.raises(InputError) as refused:
            read()
        assert str(refused.value).startswith(f"{path}: node 1: {key}={value!r} is no number of degrees from -")
        assert "\n" not in str(refused.value)


@pytest.mark.parametrize(("lat", "lon"), [("95", "37.5"), ("55.7", "181"), ("-90.5", "0")])
def test_what_lies_beyond_a_pole_is_one_line(lat: str, lon: str, tmp_path: Path) -> None:
    (tmp_path / "town.osm").write_text(xml(lat, lon), encoding="utf-8")
    with pytest.raises(InputError, match=r"town\.osm: node 1: l..='.*' is no number of degrees"):
        read_extract(tmp_path / "town.osm", tmp_path / "plain.osm")


def test_in_a_file_without_text_too(tmp_path: Path) -> None:
    (tmp_path / "town.osm").write_text(xml("95"), encoding="utf-8")
    with osmium.SimpleWriter(str(tmp_path / "town.osm.pbf")) as writer:
        for one in osmium.FileProcessor(str(tmp_path / "town.osm")):
            writer.add(one)
    with pytest.raises(InputError, match=r"town\.osm\.pbf: 1 nodes lie beyond 90 degrees"):
        read_extract(tmp_path / "town.osm.pbf", tmp_path / "plain.osm")


def test_bounds_of_text_are_one_line(tmp_path: Path) -> None:
    head = '<bounds minlat="x" minlon="" maxlat="9" maxlon="9"/>'
    (tmp_path / "town.osm").write_text(xml(head=head), encoding="utf-8")
    with pytest.raises(InputError, match=r"town\.osm: bounds: minlat='x' is no number of degrees"):
        read_extract(tmp_path / "town.osm", tmp_path / "plain.osm")


def test_on_the_equator_and_on_greenwich_is_a_place(tmp_path: Path) -> None:
    for lat, lon in (("0", "37.5"), ("51.5", "0.0"), (".0", "-0")):
        moved = xml(lat, lon).replace("55.70", f"{float(lat):.1f}0").replace('lon="37.5"', f'lon="{lon}"')
        (tmp_path / "town.osm").write_text(moved, encoding="utf-8")
        assert read_extract(tmp_path / "town.osm", tmp_path / "plain.osm").roads == 1


def length_of(path: Path) -> float:
    return max(lane.length for lane in read_network(path).lanes)


def test_a_node_at_null_is_left_out_of_its_road(workplace: Path, tmp_path: Path) -> None:
    (tmp_path / "town.osm").write_text(xml("0", "0.0"), encoding="utf-8")
    facts = convert_extract(tmp_path / "town.osm", tmp_path / "town.net.xml")
    assert facts.notes[0] == "left out what lies at 0, 0 degrees, where no road is: node 1"
    assert length_of(tmp_path / "town.net.xml") == pytest.approx(111.3, abs=1.0)


@pytest.mark.parametrize(("lat", "lon"), [("5.57", "37.5"), ("37.5", "55.7"), ("55.7", "38.5")])
def test_a_road_that_leaps_is_left_out(lat: str, lon: str, workplace: Path, tmp_path: Path) -> None:
    way = '<way id="10" version="1"><nd ref="2"/><nd ref="3"/><tag k="highway" v="tertiary"/></way></osm>'
    (tmp_path / "town.osm").write_text(xml(lat, lon).replace("</osm>", way), encoding="utf-8")
    facts = convert_extract(tmp_path / "town.osm", tmp_path / "town.net.xml")
    assert facts.notes == ("ways left out, two neighbouring nodes more than 50 km apart: way 9",)
    assert length_of(tmp_path / "town.net.xml") == pytest.approx(111.3, abs=1.0)
    (tmp_path / "town.osm").write_text(xml(lat, lon), encoding="utf-8")
    with pytest.raises(InputError, match=r"no road for cars in it .* more than 50 km apart: way 9"):
        read_extract(tmp_path / "town.osm", tmp_path / "plain.osm")


def test_across_the_date_line_is_near() -> None:
    places = places_of(np.array([7, 3, 5]), np.array([1_799_999_000, -1_799_999_000, 0]), np.array([0, 0, 0]))
    assert places.ids.tolist() == [3, 5, 7]
    assert not places.leaps([7, 3])
    assert places.leaps([7, 5])
    assert not places.leaps([7, 99])


def test_a_city_says_what_of_its_extract_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cities").mkdir()
    monkeypatch.setattr(cities, "cities_folder", lambda: tmp_path / "cities")
    town = Town()
    town.road([(0, 0), (300, 0)], "residential")
    null = '<node id="7" version="1" lat="0.0" lon="0"/></osm>'
    (tmp_path / "town.osm").write_text(town.xml().replace("</osm>", null), encoding="utf-8")
    words = ["city", "new", "town", "--osm", str(tmp_path / "town.osm"), "--country", "de", "--date", "2022-01-02"]
    done = CliRunner().invoke(cli, words, catch_exceptions=False)
    assert "left out what lies at 0, 0 degrees, where no road is: node 7" in done.output
    assert cities.load_city("town").zone == 37
