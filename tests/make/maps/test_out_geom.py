"""What Overpass writes with `out geom` and `out center` is read as `out body` is."""

from __future__ import annotations

import bz2
import re
from pathlib import Path

import pytest
from command_line import one_line
from town import make_town

from tsbench.make.maps.osm import read_extract
from tsbench.make.maps.own_extract import date_of

XML = make_town().xml()
RELATION = '<relation id="9" version="1">{}<tag k="type" v="route"/></relation></osm>'
MEMBER = '<member type="way" ref="501" role="">{}</member>'
WITH_RELATION = XML.replace("</osm>", RELATION.format(MEMBER.format("")))
BOUNDS = '<bounds minlat="55.0" minlon="37.0" maxlat="56.0" maxlon="38.0"/>'
PLACES = dict(re.findall(r'<node id="(\d+)" version="1" (lat="[^"]*" lon="[^"]*")', XML))
PLACE = PLACES["1001"]


def geom(text: str) -> str:
    """Bounds and places in ways and members, as `out geom` writes them."""
    text = re.sub(r"(<way [^>]*>)", rf"\1{BOUNDS}", text)
    text = re.sub(r'<nd ref="(\d+)"/>', lambda found: f'<nd ref="{found[1]}" {PLACES[found[1]]}/>', text)
    member = MEMBER.format("")
    return text.replace(member, BOUNDS + MEMBER.format(f"<nd {PLACE}/><nd/>"))


def plain(folder: Path, text: str, name: str = "town.osm") -> bytes:
    (folder / name).write_bytes(bz2.compress(text.encode()) if name.endswith("bz2") else text.encode())
    assert read_extract(folder / name, folder / "plain.osm").notes == ()
    return (folder / "plain.osm").read_bytes()


@pytest.mark.parametrize("name", ["town.osm", "town.osm.bz2"])
def test_repeated_places_change_nothing(name: str, tmp_path: Path) -> None:
    assert plain(tmp_path, geom(WITH_RELATION), name) == plain(tmp_path, WITH_RELATION)


def test_ways_alone_bring_their_nodes(tmp_path: Path) -> None:
    untagged = re.sub(r'(<node [^>]*) version="1"([^>]*)>.*?</node>', r"\1\2></node>", XML)
    assert "<node" not in ALONE
    assert sorted(plain(tmp_path, ALONE).splitlines()) == sorted(plain(tmp_path, untagged).splitlines())


def test_centres_change_nothing(tmp_path: Path) -> None:
    centred = re.sub(r"(<(?:way|relation) [^>]*>)", rf"\1<center {PLACE}/>", WITH_RELATION)
    assert plain(tmp_path, centred) == plain(tmp_path, WITH_RELATION)


def test_its_day_is_that_of_its_newest_object(tmp_path: Path) -> None:
    stamped = geom(WITH_RELATION).replace('version="1"', 'version="1" timestamp="2023-04-05T06:07:08Z"')
    (tmp_path / "town.osm").write_text(stamped, encoding="utf-8")
    assert date_of(tmp_path / "town.osm") == "2023-04-05"


ALONE = re.sub(r"<node .*</node>\n", "", geom(XML))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (geom(WITH_RELATION)[:-40], "not a whole OSM file"),
        (ALONE.replace(f'<nd ref="1001" {PLACE}', "<nd ref='1001' lat='55,7' lon='9'"), r"nd 1001: lat='55,7'"),
    ],
)
def test_what_is_broken_is_one_line(text: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "town.osm").write_text(text, encoding="utf-8")
    with one_line(match=says):
        read_extract(tmp_path / "town.osm", tmp_path / "plain.osm")
