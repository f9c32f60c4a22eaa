"""Roads from Overpass: what is asked and what is made of each answer, by a server here that speaks its protocol."""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from urllib.parse import parse_qs, urlparse

import pytest
from click.testing import CliRunner
from command_line import one_line
from serving import answer, serving

from tsbench.cli.city import city
from tsbench.cli.maps import maps
from tsbench.core.errors import InputError
from tsbench.make.city import load_city
from tsbench.make.maps.extracts import address, fetch_extract, is_address, parse_box
from tsbench.make.maps.osm import read_extract
from tsbench.make.maps.source import load_source
from tsbench.scenarios.data_set import DataSet

BOX = (11.5, 49.9, 11.6, 50.0)
BBOX = ("--bbox", "11.5,49.9,11.6,50.0")
ROADS = """<node id="1" lat="49.95" lon="11.55"><tag k="highway" v="traffic_signals"/></node>
<node id="2" lat="49.96" lon="11.55"/>
<way id="9"><nd ref="1"/><nd ref="2"/><tag k="highway" v="residential"/></way>"""
ANSWER = """<?xml version="1.0" encoding="UTF-8"?>
<osm version="0.6" generator="Overpass API"><note>The data included in this document is from OpenStreetMap.</note>
<meta osm_base="{hour}"/>{body}</osm>"""


class Overpass(BaseHTTPRequestHandler):
    """Answers every question with `body`, as of another hour each time; a code in its place is answered as an error."""

    body: str | int = ROADS
    asked: list[str] = []  # noqa: RUF012

    def log_message(self, format: str, *args: object) -> None:
        pass

    def do_GET(self) -> None:
        self.asked.append(parse_qs(urlparse(self.path).query)["data"][0])
        if isinstance(self.body, int):
            self.send_error(self.body)
            return
        hour = f"2026-01-01T{len(self.asked):02}:00:00Z"
        content = ANSWER.format(hour=hour, body=self.body).encode()
        answer(self, content)


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    monkeypatch.setattr(Overpass, "asked", [])
    with serving(Overpass) as there:
        yield f"{there}/api/interpreter"


def call(*arguments: str) -> str:
    done = CliRunner().invoke(maps if arguments[0] == "fetch" else city, list(arguments[1:]))
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert done.exit_code == 0, done.output
    return done.output


def test_a_box_on_a_day_is_asked_for_and_is_an_extract(server: str, tmp_path: Path) -> None:
    path = tmp_path / "here.osm.gz"
    fetch_extract(path, address(BOX, "2024-02-29", server))
    (asked,) = Overpass.asked
    assert '[date:"2024-02-29T00:00:00Z"]' in asked
    assert "(49.9,11.5,50,11.6)" in asked, "south, west, north, east"
    assert '["type"="restriction"]' in asked
    facts = read_extract(path, tmp_path / "plain.osm")
    assert (facts.nodes, facts.roads, len(facts.signals)) == (2, 1, 1)


def test_the_same_roads_are_the_same_bytes_whatever_the_hour(server: str, tmp_path: Path) -> None:
    first, second = (fetch_extract(tmp_path / name, address(BOX, None, server)) for name in ("a", "b"))
    assert first == second
    assert len(Overpass.asked) == 2
    assert "date" not in Overpass.asked[0]
    assert b"osm_base" not in gzip.decompress((tmp_path / "a").read_bytes())


@pytest.mark.parametrize(
    ("body", "told"),
    [
        (429, "answers 429.*busy: try again later"),
        (504, "answers 504.*busy"),
        (400, "answers 400 Bad Request$"),
        ("", "there is no road for cars"),
        # It comes with status 200 and whatever was found until then.
        (ROADS + "<remark>runtime error: Query timed out in 'recurse'\nafter 900 s</remark>", "broke its answer off"),
        ("</osm><osm>", "not a well-formed answer of Overpass"),
    ],
)
def test_what_is_no_answer_is_one_line_and_no_file(
    server: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, body: str | int, told: str
) -> None:
    monkeypatch.setattr(Overpass, "body", body)
    with one_line(match=told):
        fetch_extract(tmp_path / "x.osm.gz", address(BOX, None, server))
    assert not list(tmp_path.iterdir())


def test_no_server_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^http://127\.0\.0\.1:9/x: cannot be asked"):
        fetch_extract(tmp_path / "x.osm.gz", address(BOX, None, "http://127.0.0.1:9/x"))


def test_a_new_city_is_fetched_described_and_fetched_again(
    server: str, described: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    osm, where = tmp_path / "osm", (*BBOX, "--server", server)
    call("city", "new", "here", *where, "--country", "de", "--osm", str(osm), "--date", "2024-02-29")
    made = load_city("here")
    (extract,) = made.extracts
    assert (made.zone, made.country, extract.date) == (32, "de", "2024-02-29")
    assert is_address(extract.address)
    with pytest.raises(InputError, match="there is such a city already"):
        call("city", "new", "here", *where, "--country", "de", "--osm", str(osm))
    with pytest.raises(InputError, match="a city's name is of a-z"):
        call("city", "new", "../here", *where, "--country", "de", "--osm", str(osm))

    # Its own address brings the same bytes; other roads are another city.
    again = tmp_path / "again"
    assert "2024-02-29, ODbL-1.0" in call("city", "fetch", "here", "--osm", str(again))
    assert (again / "here.osm.gz").read_bytes() == (osm / "here.osm.gz").read_bytes()
    monkeypatch.setattr(Overpass, "body", ROADS.replace("49.96", "49.97"))
    with pytest.raises(InputError, match="is not that of 'here'"):
        call("city", "fetch", "here", "--osm", str(tmp_path / "changed"))


def test_a_new_city_on_a_zones_border_is_in_the_frame_of_its_extract(
    server: str, workplace: Path, described: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The middle of the box and the first node are of zone 33, most nodes of zone 32."""
    places = (12.001, 11.991, 11.995, 11.999)
    nodes = "".join(f'<node id="{k}" lat="49.95" lon="{lon}"/>' for k, lon in enumerate(places, start=1))
    way = '<way id="9">{}<tag k="highway" v="residential"/></way>'.format(
        "".join(f'<nd ref="{k}"/>' for k in (1, 4, 3, 2))
    )
    monkeypatch.setattr(Overpass, "body", nodes + way)
    where = ("--bbox", "11.99,49.9,12.02,50.0", "--server", server, "--osm", str(tmp_path))
    call("city", "new", "edge", *where, "--country", "de", "--date", "2024-02-29")
    made = load_city("edge")
    assert made.zone == 32
    town = DataSet.named("edge")
    assert load_source(town, "edge", tmp_path).frame == made.frame


@pytest.mark.parametrize(("country", "side"), [("GB", "left"), ("ie", "left"), ("in", "left"), ("NO", "right")])
def test_a_new_city_keeps_to_the_side_of_its_country(
    server: str, described: Path, tmp_path: Path, country: str, side: str
) -> None:
    where = (*BBOX, "--server", server, "--osm", str(tmp_path))
    call("city", "new", "here", *where, "--country", country)
    assert (load_city("here").country, load_city("here").side) == (country.lower(), side)


@pytest.mark.parametrize("country", ["uk", "zz", "", "deu"])
def test_what_is_no_country_is_not_fetched(server: str, described: Path, tmp_path: Path, country: str) -> None:
    where = (*BBOX, "--server", server, "--osm", str(tmp_path))
    with pytest.raises(InputError, match=f"^--country: '{country}' is no country's code: write its two letters"):
        call("city", "new", "here", *where, "--country", country)
    assert (Overpass.asked, list(tmp_path.iterdir()), list(described.iterdir())) == ([], [described], [])


def test_a_box_from_the_command_line(server: str, tmp_path: Path) -> None:
    where = (*BBOX, "--server", server, "--out", str(tmp_path))
    assert str(tmp_path / "town.osm.gz") in call("fetch", "fetch", "town", *where)
    assert parse_box("11.5,49.9,11.6,50.0") == BOX
