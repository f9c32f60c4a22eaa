"""Order, versions, deleted objects and odd places: netconvert is given what a tidy extract would give."""

from __future__ import annotations

import bz2
import gzip
import random
from pathlib import Path

import numpy as np
import osmium
import pytest
from click.testing import CliRunner
from command_line import one_line
from town import Town, make_town

from tsbench.cli import cli
from tsbench.core.errors import InputError
from tsbench.make import city as cities
from tsbench.make.maps.netconvert import convert_extract
from tsbench.make.maps.osm import contents_of, places_of, read_extract
from tsbench.make.maps.own_extract import facts_of
from tsbench.make.maps.plain import origins_and_junctions
from tsbench.make.maps.source import load_source
from tsbench.roads.network import read_network
from tsbench.scenarios.data_set import DataSet

LINES = make_town().xml().splitlines()
NODES = [line for line in LINES if line.startswith("<node")]
WAYS = [line for line in LINES if line.startswith("<way")]
RELATION = '<relation id="9" version="1"><member type="way" ref="501" role=""/><tag k="type" v="route"/></relation>'


def extract(*objects: str) -> str:
    return "\n".join(['<?xml version="1.0"?>', '<osm version="0.6">', *objects, "</osm>"])


def plain(folder: Path, text: str, name: str = "town.osm") -> tuple[bytes, tuple[str, ...]]:
    """What netconvert is given, and the notes."""
    (folder / name).write_text(text, encoding="utf-8")
    facts = read_extract(folder / name, folder / "plain.osm")
    return (folder / "plain.osm").read_bytes(), facts.notes


def mixed() -> list[str]:
    """Nodes, ways and a relation in any order; each kind in its own."""
    places = [*NODES, *WAYS, RELATION]
    random.Random(5).shuffle(places)
    rest = [iter(NODES), iter(WAYS), iter([RELATION])]
    return [next(rest[("<node", "<way", "<relation").index(one.split(" ", 1)[0])]) for one in places]


ORDERS = {
    "all ways first": [*WAYS, *NODES, RELATION],
    "relations first": [RELATION, *NODES, *WAYS],
    "some ways before their nodes": [*WAYS[:6], *NODES, *WAYS[6:], RELATION],
    "mixed": mixed(),
}


@pytest.mark.parametrize("order", ORDERS)
def test_every_order_gives_the_bytes_of_the_right_one(order: str, tmp_path: Path) -> None:
    assert plain(tmp_path, extract(*ORDERS[order])) == plain(tmp_path, extract(*NODES, *WAYS, RELATION))


@pytest.mark.parametrize("packed", ["osm.gz", "osm.bz2", "osm.pbf"])
def test_in_every_kind_of_file(packed: str, tmp_path: Path) -> None:
    right, _ = plain(tmp_path, extract(*NODES, *WAYS))
    text, file = extract(*WAYS, *NODES), tmp_path / f"other.{packed}"
    if packed == "osm.pbf":
        (tmp_path / "ways.osm").write_text(text, encoding="utf-8")
        with osmium.SimpleWriter(str(file)) as writer:
            for one in osmium.FileProcessor(str(tmp_path / "ways.osm")):
                writer.add(one)
    else:
        file.write_bytes((gzip if packed == "osm.gz" else bz2).compress(text.encode()))
    read_extract(file, tmp_path / "plain.osm")
    assert (tmp_path / "plain.osm").read_bytes() == right


def test_no_road_is_lost_for_the_order(workplace: Path, tmp_path: Path) -> None:
    (tmp_path / "right.osm").write_text(extract(*NODES, *WAYS), encoding="utf-8")
    (tmp_path / "wrong.osm").write_text(extract(*WAYS[:6], *NODES, *WAYS[6:]), encoding="utf-8")
    right, wrong = load_source(DataSet(), "right", tmp_path), load_source(DataSet(), "wrong", tmp_path)
    assert wrong.edge_ids == right.edge_ids
    assert {way for ids in wrong.osm_ids for way in ids} == set(range(501, 501 + len(WAYS)))
    assert wrong.notes == []


def test_an_extract_in_order_is_read_in_one_go(tmp_path: Path) -> None:
    (tmp_path / "town.osm").write_text(extract(*NODES, *WAYS), encoding="utf-8")
    contents = contents_of(tmp_path / "town.osm")
    assert contents.as_they_are
    assert contents.lines == ()


def test_what_needs_nothing_is_given_as_pyosmium_writes_it(tmp_path: Path) -> None:
    """The bytes that the maps of the pool were made from."""
    made, notes = plain(tmp_path, extract(*NODES, *WAYS, RELATION))
    with osmium.SimpleWriter(str(tmp_path / "copy.osm")) as writer:
        for one in osmium.FileProcessor(str(tmp_path / "town.osm")):
            writer.add(one)
    assert (tmp_path / "copy.osm").read_bytes() == made
    assert notes == ()


WAY = WAYS[3]
assert 'id="504" version="1"' in WAY
WITHOUT = extract(*NODES, *WAYS[:3], *WAYS[4:])
DELETED = {
    "action": [WAY.replace('version="1"', "version='1' action='delete'")],
    "action, old": [WAY.replace('version="1"', 'action="delete" timestamp="2020-01-01T00:00:00Z"')],
    "invisible": [WAY.replace('version="1"', 'version="1" visible="false"')],
    "later deleted": [WAY, '<way id="504" version="2" visible="false"/>'],
    "later deleted, told before": ['<way id="504" version="2" visible="false"/>', WAY],
}


@pytest.mark.parametrize("how", DELETED)
def test_what_is_deleted_is_left_out_and_said(how: str, tmp_path: Path) -> None:
    right, _ = plain(tmp_path, WITHOUT)
    made, notes = plain(tmp_path, extract(*NODES, *WAYS[:3], *DELETED[how], *WAYS[4:]))
    assert made == right
    assert notes[0] == "left out what is deleted: way 504"


def test_marks_of_an_editor_are_seen_in_packed_files_and_far_inside(tmp_path: Path) -> None:
    remark = f"<!-- {'x' * 3_000_000} -->"
    text = extract(*NODES, remark, *WAYS[:3], *DELETED["action"], *WAYS[4:])
    (tmp_path / "town.osm.gz").write_bytes(gzip.compress(text.encode()))
    facts = read_extract(tmp_path / "town.osm.gz", tmp_path / "plain.osm")
    assert facts.notes == ("left out what is deleted: way 504",)
    assert facts.roads == len(WAYS) - 1


def test_a_name_that_says_delete_deletes_nothing(tmp_path: Path) -> None:
    named = WAY.replace("</way>", '<tag k="note" v="action=&apos;delete&apos; action=\'delete\'"/></way>')
    _, notes = plain(tmp_path, extract(*NODES, *WAYS[:3], named, *WAYS[4:]))
    assert notes == ()


@pytest.mark.parametrize("newest_first", [False, True])
def test_of_several_versions_the_newest_counts(newest_first: bool, tmp_path: Path) -> None:
    new = WAY.replace('version="1"', 'version="10"').replace("residential", "primary")
    old = [WAY, WAY.replace('version="1"', 'version="9"').replace("residential", "secondary")]
    both = [new, *old] if newest_first else [*old, new]
    right, _ = plain(tmp_path, extract(*NODES, *WAYS[:3], new, *WAYS[4:]))
    made, notes = plain(tmp_path, extract(*NODES, *WAYS[:3], *both, *WAYS[4:]))
    assert made == right
    assert notes == ("of objects that stand there more than once the newest counts: 2 left out",)


def test_of_one_version_the_last_counts(tmp_path: Path) -> None:
    moved = NODES[0].replace('lat="', 'lat="0').replace('version="1"', 'version="1" ')
    right, _ = plain(tmp_path, extract(moved, *NODES[1:], *WAYS))
    made, notes = plain(tmp_path, extract(NODES[0], moved, *NODES[1:], *WAYS))
    assert made == right
    assert len(notes) == 1


def test_a_node_that_is_no_more_is_left_out_of_its_road(workplace: Path, tmp_path: Path) -> None:
    town = Town()
    town.road([(0, 0), (100, 50), (300, 0)], "residential")
    text = town.xml().replace('<node id="1002" version="1"', '<node id="1002" version="1" action="delete"')
    (tmp_path / "town.osm").write_text(text, encoding="utf-8")
    facts = convert_extract(DataSet(), tmp_path / "town.osm", tmp_path / "town.net.xml")
    assert facts.notes[0] == "left out what is deleted: node 1002"
    lengths = [lane.length for lane in read_network(tmp_path / "town.net.xml").lanes if not lane.internal]
    assert lengths == pytest.approx([300.0, 300.0], abs=0.5)


def test_only_what_counts_is_counted(tmp_path: Path) -> None:
    gone = [line.replace('version="1"', 'version="1" visible="false"') for line in WAYS]
    (tmp_path / "town.osm").write_text(extract(*NODES, *gone), encoding="utf-8")
    with pytest.raises(InputError, match=r"town\.osm: no road for cars in it \(\d+ nodes, 0 ways"):
        read_extract(tmp_path / "town.osm", tmp_path / "plain.osm")


@pytest.mark.parametrize("file", ["day.osm", "day.osm.gz"])
def test_a_file_of_changes_is_refused_in_one_line(file: str, tmp_path: Path) -> None:
    text = '<?xml version="1.0"?><osmChange version="0.6"><create>' + "".join(NODES + WAYS) + "</create></osmChange>"
    data = text.encode()
    (tmp_path / file).write_bytes(gzip.compress(data) if file.endswith(".gz") else data)
    with pytest.raises(InputError) as caught:
        read_extract(tmp_path / file, tmp_path / "plain.osm")
    told = "a file of changes, not of roads: apply it to an extract with `osmium apply-changes`"
    assert str(caught.value) == f"{tmp_path / file}: {told}"


def test_origins_are_those_of_the_network(workplace: Path, tmp_path: Path) -> None:
    (tmp_path / "town.osm").write_text(extract(*NODES, *WAYS), encoding="utf-8")
    for out in ("town.net.xml", "town.net.xml.gz"):
        convert_extract(DataSet(), tmp_path / "town.osm", tmp_path / out)
        ways, junctions = origins_and_junctions([tmp_path / out])
        assert ways == set(range(501, 501 + len(WAYS)))
        assert junctions[1001] == "1001"


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
        with one_line(f"{path}: node 1: {key}={value!r} is no number of degrees from -"):
            read()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (xml("95", "37.5"), "node 1: lat='95'"),
        (xml("55.7", "181"), "node 1: lon='181'"),
        (xml("-90.5", "0"), "node 1: lat='-90.5'"),
        (xml(head='<bounds minlat="x" minlon="" maxlat="9" maxlon="9"/>'), "bounds: minlat='x'"),
    ],
)
def test_a_place_beyond_a_pole_or_of_text_is_one_line(content: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "town.osm").write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=rf"town\.osm: {words} is no number of degrees"):
        read_extract(tmp_path / "town.osm", tmp_path / "plain.osm")


def test_in_a_file_without_text_too(tmp_path: Path) -> None:
    (tmp_path / "town.osm").write_text(xml("95"), encoding="utf-8")
    with osmium.SimpleWriter(str(tmp_path / "town.osm.pbf")) as writer:
        for one in osmium.FileProcessor(str(tmp_path / "town.osm")):
            writer.add(one)
    with pytest.raises(InputError, match=r"town\.osm\.pbf: 1 nodes lie beyond 90 degrees"):
        read_extract(tmp_path / "town.osm.pbf", tmp_path / "plain.osm")


def test_on_the_equator_and_on_greenwich_is_a_place(tmp_path: Path) -> None:
    for lat, lon in (("0", "37.5"), ("51.5", "0.0"), (".0", "-0")):
        moved = xml(lat, lon).replace("55.70", f"{float(lat):.1f}0").replace('lon="37.5"', f'lon="{lon}"')
        (tmp_path / "town.osm").write_text(moved, encoding="utf-8")
        assert read_extract(tmp_path / "town.osm", tmp_path / "plain.osm").roads == 1


def length_of(path: Path) -> float:
    return max(lane.length for lane in read_network(path).lanes)


def test_a_node_at_null_is_left_out_of_its_road(workplace: Path, tmp_path: Path) -> None:
    (tmp_path / "town.osm").write_text(xml("0", "0.0"), encoding="utf-8")
    facts = convert_extract(DataSet(), tmp_path / "town.osm", tmp_path / "town.net.xml")
    assert facts.notes[0] == "left out what lies at 0, 0 degrees, where no road is: node 1"
    assert length_of(tmp_path / "town.net.xml") == pytest.approx(111.3, abs=1.0)


@pytest.mark.parametrize(("lat", "lon"), [("5.57", "37.5"), ("37.5", "55.7"), ("55.7", "38.5")])
def test_a_road_that_leaps_is_left_out(lat: str, lon: str, workplace: Path, tmp_path: Path) -> None:
    way = '<way id="10" version="1"><nd ref="2"/><nd ref="3"/><tag k="highway" v="tertiary"/></way></osm>'
    (tmp_path / "town.osm").write_text(xml(lat, lon).replace("</osm>", way), encoding="utf-8")
    facts = convert_extract(DataSet(), tmp_path / "town.osm", tmp_path / "town.net.xml")
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


def test_a_city_says_what_of_its_extract_is_left_out(described: Path, tmp_path: Path) -> None:
    town = Town()
    town.road([(0, 0), (300, 0)], "residential")
    null = '<node id="7" version="1" lat="0.0" lon="0"/></osm>'
    (tmp_path / "town.osm").write_text(town.xml().replace("</osm>", null), encoding="utf-8")
    words = ["city", "new", "town", "--osm", str(tmp_path / "town.osm"), "--country", "de", "--date", "2022-01-02"]
    done = CliRunner().invoke(cli, words, catch_exceptions=False)
    assert "left out what lies at 0, 0 degrees, where no road is: node 7" in done.output
    assert cities.load_city("town").zone == 37
