"""Which files are extracts, what they are called, and that no name means two of them."""

from __future__ import annotations

import bz2
import gzip
from pathlib import Path

import pytest
from town import make_town

from tsbench.core.errors import InputError
from tsbench.make.city import find_extract, list_extracts
from tsbench.make.maps.extracts import SUFFIXES, check_file, extract_name, extracts_in, file_at
from tsbench.make.maps.netconvert import convert_extract
from tsbench.make.maps.source import SourceNetwork, load_source
from tsbench.scenarios.data_set import DataSet

TOWN = make_town().xml().encode()


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("nw-moscow.osm.gz", "nw-moscow"),
        ("st.gallen.osm", "st.gallen"),
        ("st.gallen-2013.01.02.osm.pbf", "st.gallen-2013.01.02"),
        ("x.osm.xml.gz", "x"),
        ("x.osm.xml", "x"),
        ("x.xml.bz2", "x"),
        ("TOWN.OSM", "TOWN"),
        ("Town.Osm.Gz", "Town"),
        ("a, b.pbf", "a, b"),
    ],
)
def test_a_name_is_all_but_the_ending(file: str, name: str) -> None:
    assert extract_name(Path("some.where") / file) == name


@pytest.mark.parametrize("ending", sorted({*SUFFIXES, ".OSM", ".Osm.XML.GZ"}))
def test_every_file_that_is_listed_is_found_by_its_name(ending: str, tmp_path: Path) -> None:
    packed = gzip.compress(TOWN) if ending.lower().endswith(".gz") else TOWN
    packed = bz2.compress(TOWN) if ending.endswith(".bz2") else packed
    file = tmp_path / f"st.gallen{ending}"
    file.write_bytes(packed)
    assert list_extracts(DataSet(), tmp_path) == [file]
    assert find_extract(DataSet(), "st.gallen", tmp_path) == file


@pytest.mark.parametrize("file", ["st.gallen.osm", "TOWN.OSM", "x.osm.xml.gz", "Y.XML.BZ2"])
def test_it_is_read_under_that_name(file: str, tiny: SourceNetwork, tmp_path: Path) -> None:
    packed = {".gz": gzip.compress, ".bz2": bz2.compress}.get(Path(file.lower()).suffix, bytes)
    (tmp_path / file).write_bytes(packed(TOWN))
    name = extract_name(Path(file))
    source = load_source(DataSet(), name, tmp_path)
    assert source.name == name
    assert source.edge_ids == tiny.edge_ids
    assert convert_extract(DataSet(), tmp_path / file, tmp_path / "town.net.xml").roads == len(make_town().ways)


def test_other_files_do_not_matter(tmp_path: Path) -> None:
    (tmp_path / "town.osm").write_bytes(TOWN)
    (tmp_path / "folder.osm").mkdir()
    for file, content in {
        "._town.osm": b"\x00\x05\x16\x07Mac OS X",
        ".hidden.osm": TOWN,
        "town.net.xml": b'<?xml version="1.0"?>\n<net version="1.20">',
        "town.xml": b"<types/>",
        "cut.xml.gz": b"\x1f\x8b",
        "town.osm.part": TOWN,
        "town.osm~": TOWN,
        "town.osc.gz": b"",
        "README.txt": b"",
    }.items():
        (tmp_path / file).write_bytes(content)
    assert list_extracts(DataSet(), tmp_path) == [tmp_path / "town.osm"]
    assert find_extract(DataSet(), "town", tmp_path) == tmp_path / "town.osm"


@pytest.mark.parametrize("files", [("town.osm", "town.xml"), ("town.osm", "town.osm.gz"), ("TOWN.osm", "town.osm")])
def test_a_name_of_two_files_is_refused_in_one_line(files: tuple[str, str], tmp_path: Path) -> None:
    for file in files:
        (tmp_path / file).write_bytes(gzip.compress(TOWN) if file.endswith(".gz") else TOWN)
    told = f"{tmp_path}: {files[0]} and {files[1]} are one extract by their names: rename or remove all but one"
    for call in (lambda: list_extracts(DataSet(), tmp_path), lambda: find_extract(DataSet(), "town", tmp_path)):
        with pytest.raises(InputError) as caught:
            call()
        assert str(caught.value) == told
    # To who asks for another one these are strangers.
    (tmp_path / "other.osm").write_bytes(TOWN)
    assert find_extract(DataSet(), "other", tmp_path) == tmp_path / "other.osm"


def test_a_name_in_other_letters_is_said(tmp_path: Path) -> None:
    (tmp_path / "TOWN.OSM").write_bytes(TOWN)
    with pytest.raises(InputError, match=r"no extract 'town' here .*\(TOWN\.OSM is not called so: rename it\)"):
        find_extract(DataSet(), "town", tmp_path)
    assert extracts_in(tmp_path / "nowhere") == {}


@pytest.mark.parametrize(
    ("file", "says"),
    [
        ("day.osc.gz", r"day\.osc\.gz: a file of changes, not of roads: .*osmium apply-changes"),
        ("all.osh.pbf", r"all\.osh\.pbf: a file of all that ever was: .*osmium time-filter"),
        ("town.o5m", r"town\.o5m: unknown kind of file"),
    ],
)
def test_other_kinds_of_openstreetmap_files_say_what_makes_an_extract(file: str, says: str, tmp_path: Path) -> None:
    (tmp_path / file).write_bytes(b"x")
    with pytest.raises(InputError, match=says):
        check_file(tmp_path / file)


@pytest.mark.parametrize(
    ("address", "file"),
    [
        ("https://x.org/a/north-bayreuth.osm.gz", "st.gallen.osm.gz"),
        ("https://x.org/st.gallen-2013.osm.pbf?raw=true", "st.gallen.osm.pbf"),
        ("https://x.org/Town.OSM", "st.gallen.osm"),
    ],
)
def test_a_fetched_file_has_the_name_of_its_extract(address: str, file: str) -> None:
    assert file_at("st.gallen", address) == file
