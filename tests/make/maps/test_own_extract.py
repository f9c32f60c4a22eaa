"""`tsbench city new NAME --osm FILE`: an extract that somebody has, described."""

from __future__ import annotations

import gzip
import hashlib
from pathlib import Path

import pytest
from click.testing import CliRunner
from command_line import one_line

from tsbench.cli import cli
from tsbench.core.errors import InputError
from tsbench.make.city import City, check_extract, load_city
from tsbench.make.maps.own_extract import date_of

NODES = "".join(f'<node id="{k}" version="1"{{}} lat="49.95" lon="{lon}"/>' for k, lon in ((1, 11.50), (2, 11.51)))
WAY = '<way id="9"><nd ref="1"/><nd ref="2"/><tag k="highway" v="residential"/></way>'


def extract(path: Path, head: str = "", stamp: str = "") -> Path:
    text = f'<osm version="0.6">{head}{NODES.format(stamp, "")}{WAY}</osm>'.encode()
    path.write_bytes(gzip.compress(text) if path.suffix == ".gz" else text)
    return path


def new(name: str, *options: object) -> str:
    words = ["city", "new", name, *map(str, options)]
    return CliRunner().invoke(cli, words, catch_exceptions=False).output


def only(city: City, path: Path) -> None:
    """The city is of this file and no other."""
    (found,) = city.extracts
    assert (found.sha256, found.bytes) == (hashlib.sha256(path.read_bytes()).hexdigest(), path.stat().st_size)
    check_extract(found, path)


def test_all_that_the_file_says_is_filled_in(described: Path, tmp_path: Path) -> None:
    path = extract(tmp_path / "Old.Town.osm.gz", '<meta osm_base="2024-03-01T10:00:00Z"/>')
    said = new("town", "--osm", path, "--country", "DE", "--address", "https://example.org/old")
    assert f"tsbench city build town --osm {tmp_path}" in said
    city = load_city("town")
    only(city, path)
    (found,) = city.extracts
    assert (found.name, found.date, found.address) == ("Old.Town", "2024-03-01", "https://example.org/old")
    assert (city.zone, city.country, city.side, city.types) == (32, "de", "right", "country")


def test_the_day_is_that_of_the_head_or_the_newest_object_or_said(described: Path, tmp_path: Path) -> None:
    stamped = extract(tmp_path / "b.osm", stamp=' timestamp="2023-05-06T07:08:09Z"')
    assert date_of(stamped) == "2023-05-06"
    bare = extract(tmp_path / "c.osm")
    assert date_of(bare) is None
    with pytest.raises(InputError, match=r"c\.osm: does not say of which day it is: say it with --date"):
        new("town", "--osm", bare, "--country", "de")
    assert not list(described.iterdir())
    new("town", "--osm", bare, "--country", "de", "--date", "2022-01-02")
    (found,) = load_city("town").extracts
    assert (found.date, found.address) == ("2022-01-02", "the file c.osm")


@pytest.mark.parametrize(
    ("content", "options", "said"),
    [
        (None, (), "no such file"),
        ("", (), "the file is empty"),
        ('<osm version="0.6"></osm>', (), "no node of it has a place"),
        ('<osm version="0.6"><node id="1"', (), "not a whole OSM file"),
        ("<osm/>", ("--bbox", "1,2,3,4"), "a file has its roads: leave out --bbox"),
        ("<osm/>", ("--ground",), "a file has its roads"),
    ],
)
def test_what_is_no_extract_is_one_line_and_no_city(
    described: Path, tmp_path: Path, content: str | None, options: tuple[str, ...], said: str
) -> None:
    path = tmp_path / "x.osm"
    if content is not None:
        path.write_text(content)
    with one_line(match=said):
        new("town", "--osm", path, "--country", "de", "--date", "2022-01-02", *options)
    assert not list(described.iterdir())


@pytest.mark.parametrize("options", [(), ("--address", "https://example.org")])
def test_without_roads_nothing_is_asked(described: Path, tmp_path: Path, options: tuple[str, ...]) -> None:
    with pytest.raises(InputError, match="name the roads: --bbox"):
        new("town", "--osm", tmp_path, "--country", "de", *options)
