"""Which numbers a road's tags may have, which ways are roads for cars, and what netconvert is given of them."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from town import Town

from tsbench.core.errors import InputError
from tsbench.make.city import types_file
from tsbench.make.maps.netconvert import convert_extract
from tsbench.make.maps.osm import read_extract
from tsbench.make.maps.plain import class_speeds, origins_and_junctions
from tsbench.make.maps.road_tags import (
    BOUNDS,
    CAR_ROADS,
    ClosedRoads,
    SetAside,
    closed_by,
    for_cars,
    is_plausible,
    some,
)
from tsbench.make.maps.source import load_source
from tsbench.roads.network import Lane, read_network
from tsbench.scenarios.data_set import DataSet

RESIDENTIAL_MPS = 11.11


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("maxspeed", "50"), ("maxspeed", "5"), ("maxspeed", "30 mph"), ("maxspeed", "90 mph"),
        ("maxspeed", "RU:urban"), ("maxspeed", "DE:zone30"), ("maxspeed", "DE:30"), ("maxspeed", "walk"),
        ("maxspeed", "50;30"), ("maxspeed", "fifty"), ("maxspeed", ""), ("maxspeed", "13.9 m/s"), ("lanes", "16"),
        ("lanes", "1.5"), ("lanes", "two"), ("lanes", "2;3"), ("lanes:forward", "0"), ("width", "2.5"),
        ("width", "7.5 m"), ("width", "230 cm"), ("width", "7'6\""), ("width:lanes", "3.5|3|2.75"),
        ("maxspeed:hgv", "0"), ("lanes:psv", "0"), ("name", "5030"),
    ],
)  # fmt: skip
def test_what_a_road_may_be(key: str, value: str) -> None:
    assert is_plausible(key, value)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("maxspeed", "0"), ("maxspeed", "-1"), ("maxspeed", "5030"), ("maxspeed", "1e4"), ("maxspeed", "inf"),
        ("maxspeed", "nan"), ("maxspeed", "0xFFF"), ("maxspeed", "DE:5030"), ("maxspeed", "DE:zone300"),
        ("maxspeed", "150 mph"), ("maxspeed", "5030 km/h"), ("maxspeed", "100 knots"), ("maxspeed", "50 m/s"),
        ("maxspeed:forward", "0"), ("maxspeed:backward", "5030"), ("maxspeed:type", "5030"), ("lanes", "0"),
        ("lanes", "40"), ("lanes", "-2"), ("lanes", "0;2"), ("lanes", "+40"), ("lanes:forward", "40"),
        ("lanes:backward", "-3"), ("lanes:both_ways", "40"), ("width", "300"), ("width", "0"), ("width", " 300 m "),
        ("width", "300 ft"), ("width:lanes", "3|300"), ("width:lanes:forward", "300"),
    ],
)  # fmt: skip
def test_what_no_road_is(key: str, value: str) -> None:
    assert not is_plausible(key, value)


# By odd tag: the tags of a road, and lanes and speed of its edges (there, back) as if it were not tagged.
ODD = {
    "maxspeed=0": ({"maxspeed": "0"}, 1, 1),
    "maxspeed=5030": ({"maxspeed": "5030"}, 1, 1),
    "maxspeed:forward=0": ({"maxspeed:forward": "0"}, 1, 1),
    "maxspeed:backward=5030": ({"maxspeed:backward": "5030"}, 1, 1),
    "lanes=0": ({"lanes": "0"}, 1, 1),
    "lanes=40": ({"lanes": "40"}, 1, 1),
    "lanes=0;2": ({"lanes": "0;2"}, 1, 1),
    "lanes:forward=40": ({"lanes": "4", "lanes:forward": "40"}, 2, 2),
    "lanes:backward=-3": ({"lanes:backward": "-3"}, 1, 1),
    "width=300": ({"width": "300"}, 1, 1),
    "width:lanes:forward=300": ({"width:lanes:forward": "300"}, 1, 1),
}


@pytest.mark.parametrize("odd", ODD)
def test_the_tag_is_set_aside_and_the_road_stays(odd: str, workplace: Path, tmp_path: Path) -> None:
    tags, there, back = ODD[odd]
    lanes, notes = converted(tmp_path, [("residential", tags), ("residential", {})])
    key, value = odd.split("=")
    least, most, unit = BOUNDS[key]
    assert notes == (f"the tag {key} set aside, not {least:g} to {most:g}{unit}: {value!r} of way 501",)
    assert [sum(lane.edge == edge for lane in lanes) for edge in ("501", "-501")] == [there, back]
    assert {lane.speed for lane in lanes} == {RESIDENTIAL_MPS}
    assert {lane.width for lane in lanes} == {3.25}
    source = load_source(DataSet(), "town", tmp_path)
    assert sorted(source.edge_ids) == ["-501", "-502", "501", "502"]
    assert source.notes == list(notes)


def test_in_a_mirror_too(tmp_path: Path) -> None:
    town = Town()
    town.road([(0, 0), (300, 0)], "residential", maxspeed="5030", **{"sidewalk": "left"})
    (tmp_path / "town.osm").write_text(town.xml(), encoding="utf-8")
    facts = read_extract(tmp_path / "town.osm", tmp_path / "image.osm", in_mirror=True)
    image = (tmp_path / "image.osm").read_text()
    assert "maxspeed" not in image
    assert 'k="sidewalk" v="right"' in image
    assert len(facts.notes) == 1


def test_what_is_no_road_for_cars_keeps_its_numbers(tmp_path: Path) -> None:
    town = Town()
    town.road([(0, 0), (300, 0)], "residential")
    town.ways.append((town.ways[0][0], {"railway": "rail", "maxspeed": "300"}))
    town.ways.append((town.ways[0][0], {"waterway": "river", "width": "300"}))
    (tmp_path / "town.osm").write_text(town.xml(), encoding="utf-8")
    assert read_extract(tmp_path / "town.osm", tmp_path / "plain.osm").notes == ()
    assert (tmp_path / "plain.osm").read_text().count('v="300"') == 2


def converted(folder: Path, roads: list[tuple[str, dict[str, str]]]) -> tuple[list[Lane], tuple[str, ...]]:
    """The lanes of a town of these roads, by class and tags, in parallel; the notes."""
    town = Town()
    for row, (highway, tags) in enumerate(roads):
        town.road([(0, 100.0 * row), (300, 100.0 * row)], highway, **tags)
    (folder / "town.osm").write_text(town.xml(), encoding="utf-8")
    facts = convert_extract(DataSet(), folder / "town.osm", folder / "town.net.xml")
    assert facts.roads == len(roads)
    return [lane for lane in read_network(folder / "town.net.xml").lanes if not lane.internal], facts.notes


SPEED_KEYS = ("maxspeed", "maxspeed:forward", "maxspeed:backward", "maxspeed:type", "zone:maxspeed")


@pytest.mark.parametrize("value", ["none", "no", "DE:motorway"])
def test_no_limit_is_believed_on_motorways_and_trunks_only(value: str, workplace: Path, tmp_path: Path) -> None:
    slow = ("living_street", "residential", "unclassified", "tertiary", "secondary", "primary", "trunk_link")
    roads = [(highway, {key: value}) for highway in slow for key in SPEED_KEYS]
    lanes, notes = converted(tmp_path, [*roads, ("motorway", {"maxspeed": value}), ("trunk", {"maxspeed": value})])
    usual = class_speeds(types_file(DataSet()))
    for row, (highway, _) in enumerate(roads, start=501):
        speeds = {lane.speed for lane in lanes if lane.edge in (f"{row}", f"-{row}")}
        assert speeds == {usual[f"highway.{highway}"]}
    fast = {lane.speed for lane in lanes if abs(int(lane.edge)) > 500 + len(roads)}
    assert min(fast) > 39.0
    said = "set aside, only motorways and trunks have no limit"
    assert sum(said in note for note in notes) == len(SPEED_KEYS)
    assert notes[0].startswith(f"the tag maxspeed {said}: {value!r} of way 501, ")


# By tags: lanes there and back.
MIDDLE = [
    ({"lanes": "3", "lanes:both_ways": "1"}, 1, 1),
    ({"lanes": "5", "lanes:forward": "2", "lanes:both_ways": "1"}, 2, 2),
    ({"lanes": "3", "lanes:forward": "1", "lanes:backward": "1", "lanes:both_ways": "1"}, 1, 1),
    ({"lanes": "1", "lanes:both_ways": "1"}, 1, 1),
    ({"lanes:both_ways": "1"}, 1, 1),
]


def test_a_lane_for_both_directions_is_none_forward(workplace: Path, tmp_path: Path) -> None:
    lanes, notes = converted(tmp_path, [("residential", tags) for tags, _, _ in MIDDLE])
    edges = [lane.edge for lane in lanes]
    found = [(edges.count(f"{row}"), edges.count(f"-{row}")) for row in range(501, 501 + len(MIDDLE))]
    assert found == [(there, back) for _, there, back in MIDDLE]
    said = "the tag lanes:both_ways set aside, lanes for both directions are not made: '1' of way 501, "
    assert notes[0].startswith(said)


def test_tags_of_single_lanes_are_counted(workplace: Path, tmp_path: Path) -> None:
    by_lane = {
        "access:lanes": "yes|no", "vehicle:lanes": "yes|no", "motor_vehicle:lanes": "yes|no",
        "bus:lanes": "|designated", "maxspeed:lanes": "50|30", "vehicle:lanes:forward": "yes|no",
        "lanes:psv": "1", "lanes:bus:forward": "1", "hov:lanes": "|designated",
    }  # fmt: skip
    told = {key: value for key, value in by_lane.items() if key != "bus:lanes"}
    plain = {"oneway": "yes", "lanes": "2"}
    lanes, notes = converted(tmp_path, [("residential", {**plain, **tags}) for tags in (by_lane, told, {})])
    assert len(lanes) == 6
    assert {lane.speed for lane in lanes} == {RESIDENTIAL_MPS}
    assert sum("not used, all lanes are alike" in note for note in notes) == len(by_lane)
    assert "the tag bus:lanes not used, all lanes are alike: '|designated' of way 501" in notes
    said = "the tag maxspeed:lanes not used, all lanes are alike: '50|30' of way 501, '50|30' of way 502"
    assert said in notes


def test_turns_of_lanes_are_no_line(tmp_path: Path) -> None:
    aside = SetAside()
    aside.from_road(1, {"highway": "primary", "turn:lanes": "left|right", "lanes:forward": "2", "change:lanes": "yes"})
    assert aside.lines() == []


def test_a_line_names_the_first_and_counts_the_others() -> None:
    aside = SetAside()
    assert aside.from_road(7, {"highway": "primary", "lanes": "2"}) == {"highway": "primary", "lanes": "2"}
    assert aside.from_road(8, {"highway": "primary", "lanes": "99"}) == {"highway": "primary"}
    assert aside.lines() == ["the tag lanes set aside, not 1 to 16: '99' of way 8"]
    assert some(["a", "b", "c"], 2) == "a, b and 1 more"
    assert some(["a", "b"], 2) == "a, b"


HERE = Path(__file__).parent
CASES: dict[str, dict[str, dict[str, str]]] = yaml.safe_load((HERE / "car_roads.yaml").read_text(encoding="utf-8"))
# Roads of the case file that netconvert has to make edges of; the others are closed to cars or no roads for them.
OPEN_WAYS = {1007, 1010, 1011, 1012, 1016, 1017}
# What is open, but netconvert closes it: its tags are left as they are.
LEFT_AS_IT_IS = "closed to all, cars may one way"


@pytest.mark.parametrize("tag", CASES["closed"])
def test_a_tag_that_closes_a_road(tag: str) -> None:
    assert closed_by(CASES["closed"][tag]) == tag


@pytest.mark.parametrize("kind", ["open", "not a road"])
def test_what_is_not_closed(kind: str) -> None:
    assert {name: closed_by(tags) for name, tags in CASES[kind].items()} == dict.fromkeys(CASES[kind])


@pytest.mark.parametrize("road", sorted(CAR_ROADS))
def test_every_class_of_roads_can_be_closed(road: str) -> None:
    assert closed_by({"highway": road, "motor_vehicle": "no"}) == "motor_vehicle=no"
    assert closed_by({"highway": road}) is None


def test_an_access_that_is_overruled_is_not_handed_on() -> None:
    opened = {"highway": "residential", "access": "no", "motor_vehicle": "yes"}
    assert for_cars(opened) == {"highway": "residential", "motor_vehicle": "yes"}
    for tags in ({"access": "destination", "motorcar": "yes"}, {"access": "no"}, {"motor_vehicle": "yes"}):
        assert for_cars(tags) is tags
    one_way = CASES["open"][LEFT_AS_IT_IS]
    assert for_cars(one_way) is one_way


@pytest.mark.parametrize(
    ("tags", "one_way"),
    [
        ({"oneway:motor_vehicle": "yes"}, "yes"),
        ({"oneway": "yes", "oneway:motor_vehicle": "no"}, "no"),
        ({"oneway:vehicle": "yes", "oneway:motor_vehicle": "no", "oneway:motorcar": "-1"}, "-1"),
        ({"oneway": "yes", "oneway:bicycle": "no"}, "yes"),
        ({"oneway:bus": "no"}, None),
    ],
)
def test_the_direction_is_that_of_cars(tags: dict[str, str], one_way: str | None) -> None:
    assert for_cars(tags).get("oneway") == one_way


def test_a_road_that_is_one_way_for_cars_only_has_one_edge(workplace: Path, tmp_path: Path) -> None:
    one_way = ({"oneway:motor_vehicle": "yes"}, {"oneway": "yes", "oneway:motorcar": "no"})
    lanes, _ = converted(tmp_path, [("residential", tags) for tags in one_way])
    assert sorted(lane.edge for lane in lanes) == ["-502", "501", "502"]


def test_netconvert_gets_the_open_roads_only(workplace: Path, tmp_path: Path) -> None:
    """All labelled ways as one town: by number, 501 the first."""
    town, rows = Town(), [(kind, name, tags) for kind in CASES for name, tags in CASES[kind].items()]
    for row, (_, _, tags) in enumerate(rows):
        ends = [town.node(x, 100.0 * row) for x in (0, 300)]
        town.ways.append((ends, tags))
    (tmp_path / "town.osm").write_text(town.xml(), encoding="utf-8")
    facts = convert_extract(DataSet(), tmp_path / "town.osm", tmp_path / "town.net.xml")
    ways, _ = origins_and_junctions([tmp_path / "town.net.xml"])
    made = {rows[way - 501][1] for way in ways}
    assert made == set(CASES["open"]) - {LEFT_AS_IT_IS}
    assert facts.roads == len(CASES["open"])
    (note,) = [line for line in facts.notes if "closed to cars: " in line]
    assert note.startswith(f"ways left out, closed to cars: {len(CASES['closed'])} (abandoned=yes 1, ")
    assert note.endswith(f"way 501, way 502, way 503, way 504, way 505 and {len(CASES['closed']) - 5} more")


def test_the_case_file_keeps_its_open_roads(workplace: Path, tmp_path: Path) -> None:
    facts = convert_extract(DataSet(), HERE / "closed-to-cars.osm", tmp_path / "town.net.xml")
    ways, _ = origins_and_junctions([tmp_path / "town.net.xml"])
    assert ways == OPEN_WAYS == set(facts.road_ends)
    assert (
        "ways left out, closed to cars: 11 (access=no 3, abandoned=yes 1, access=private 1, area=yes 1, "
        "motor_vehicle=forestry 1, motor_vehicle=no 1, motor_vehicle=private 1, motorcar=no 1, vehicle=no 1): "
        "way 1000, way 1001, way 1002, way 1003, way 1004 and 6 more"
    ) in facts.notes


def test_a_town_that_is_closed_to_cars_has_no_road_for_them(tmp_path: Path) -> None:
    town = Town()
    for row in range(3):
        town.road([(0, 100.0 * row), (300, 100.0 * row)], "residential", motor_vehicle="no")
    town.road([(0, 0), (0, 200)], "tertiary", area="yes")
    (tmp_path / "town.osm").write_text(town.xml(), encoding="utf-8")
    says = "6 nodes, 4 ways, all 4 roads are closed to cars: motor_vehicle=no 3, area=yes 1"
    with pytest.raises(InputError, match=says):
        read_extract(tmp_path / "town.osm", tmp_path / "plain.osm")


def test_a_closed_road_has_no_tags_set_aside(tmp_path: Path) -> None:
    town = Town()
    town.road([(0, 0), (300, 0)], "residential", access="private", maxspeed="5030")
    town.road([(0, 100), (300, 100)], "residential", access="no", motor_vehicle="yes", maxspeed="5030")
    (tmp_path / "town.osm").write_text(town.xml(), encoding="utf-8")
    notes = read_extract(tmp_path / "town.osm", tmp_path / "plain.osm").notes
    assert notes == (
        "ways left out, closed to cars: 1 (access=private 1): way 501",
        "the tag maxspeed set aside, not 3 to 150 km/h: '5030' of way 502",
    )
    written = (tmp_path / "plain.osm").read_text(encoding="utf-8")
    assert 'id="501"' not in written
    assert 'k="access"' not in written


def test_nothing_closed_is_no_line() -> None:
    assert ClosedRoads().lines() == []
