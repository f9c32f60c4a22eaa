"""Which ways are roads for cars: labelled ways, and what netconvert is given of them."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from town import Town

from tsbench.core.errors import InputError
from tsbench.make.maps.netconvert import convert_extract
from tsbench.make.maps.osm import read_extract
from tsbench.make.maps.plain import origins_and_junctions
from tsbench.make.maps.road_tags import CAR_ROADS, ClosedRoads, closed_by, for_cars
from tsbench.roads.network import read_network

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
    town = Town()
    for row, tags in enumerate(({"oneway:motor_vehicle": "yes"}, {"oneway": "yes", "oneway:motorcar": "no"})):
        town.road([(0, 100.0 * row), (300, 100.0 * row)], "residential", **tags)
    (tmp_path / "town.osm").write_text(town.xml(), encoding="utf-8")
    convert_extract(tmp_path / "town.osm", tmp_path / "town.net.xml")
    lanes = read_network(tmp_path / "town.net.xml").lanes
    assert sorted(lane.edge for lane in lanes if not lane.internal) == ["-502", "501", "502"]


def test_netconvert_gets_the_open_roads_only(workplace: Path, tmp_path: Path) -> None:
    """All labelled ways as one town: by number, 501 the first."""
    town, rows = Town(), [(kind, name, tags) for kind in CASES for name, tags in CASES[kind].items()]
    for row, (_, _, tags) in enumerate(rows):
        ends = [town.node(x, 100.0 * row) for x in (0, 300)]
        town.ways.append((ends, tags))
    (tmp_path / "town.osm").write_text(town.xml(), encoding="utf-8")
    facts = convert_extract(tmp_path / "town.osm", tmp_path / "town.net.xml")
    ways, _ = origins_and_junctions([tmp_path / "town.net.xml"])
    made = {rows[way - 501][1] for way in ways}
    assert made == set(CASES["open"]) - {LEFT_AS_IT_IS}
    assert facts.roads == len(CASES["open"])
    (note,) = [line for line in facts.notes if "closed to cars: " in line]
    assert note.startswith(f"ways left out, closed to cars: {len(CASES['closed'])} (abandoned=yes 1, ")
    assert note.endswith(f"way 501, way 502, way 503, way 504, way 505 and {len(CASES['closed']) - 5} more")


def test_the_case_file_keeps_its_open_roads(workplace: Path, tmp_path: Path) -> None:
    facts = convert_extract(HERE / "closed-to-cars.osm", tmp_path / "town.net.xml")
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
