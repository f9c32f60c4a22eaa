"""`tsbench maps` from the outside."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from tsbench.cli.maps import maps
from tsbench.core.errors import InputError
from tsbench.dataset.maps import fetch as fetching
from tsbench.dataset.maps.fetch import fetch_extract, parse_box

OSM = """<?xml version="1.0"?><osm version="0.6">
<node id="1" version="1" lat="55.80" lon="37.40"/><node id="2" version="1" lat="55.801" lon="37.40"/>
<way id="9" version="1"><nd ref="1"/><nd ref="2"/><tag k="highway" v="residential"/></way></osm>"""


def call(*arguments: str) -> str:
    done = CliRunner().invoke(maps, list(arguments))
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done.output


def test_convert(tmp_path: Path) -> None:
    (tmp_path / "one.osm").write_text(OSM)
    said = call("convert", str(tmp_path / "one.osm"), "--out", str(tmp_path / "new" / "one.net.xml"))
    assert "1 of them roads for cars" in said
    assert "<net " in (tmp_path / "new" / "one.net.xml").read_text()


def test_convert_says_what_is_wrong(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        call("convert", str(tmp_path / "none.osm"), "--out", str(tmp_path / "one.net.xml"))


@pytest.mark.own_process
def test_stats_of_the_committed_pool(tmp_path: Path) -> None:
    said = call("stats", "--png", str(tmp_path / "map.png"))
    assert "Maps by family and shape" in said
    assert (tmp_path / "map.png").stat().st_size > 10_000


def test_harvest_of_an_empty_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no OSM extract"):
        call("harvest", "--osm", str(tmp_path), "--out", str(tmp_path / "pool.parquet"))


@pytest.mark.own_process
def test_show_of_an_unknown_map(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="j-nowhere-0: no such map"):
        call("show", "j-nowhere-0", "--out", str(tmp_path / "x.png"))


@pytest.mark.parametrize("box", ["1,2,3", "a,b,c,d", "37.7,55.7,37.6,55.8", "30,50,40,60"])
def test_a_bad_box_is_one_line(box: str) -> None:
    with pytest.raises(InputError, match="--bbox"):
        parse_box(box)


def test_fetch_without_osmnx(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "osmnx", None)
    with pytest.raises(InputError, match=r"pip install 'tsbench\[make\]'"):
        fetch_extract(tmp_path, name=None, place="Arbat, Moscow", box=None)
    with pytest.raises(InputError, match="not both"):
        fetch_extract(tmp_path, name=None, place=None, box=None)


class NoNetwork:
    """OSMnx on a machine without a network."""

    class settings:  # noqa: N801 (OSMnx's own name)
        pass

    class graph:  # noqa: N801
        @staticmethod
        def graph_from_place(place: str, **options: object) -> object:
            raise ConnectionError("Max retries exceeded:\nname resolution failed")


def test_fetch_without_a_network_is_one_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "osmnx", NoNetwork)
    with pytest.raises(InputError) as caught:
        call("fetch", "Arbat, Moscow", "--out", str(tmp_path))
    assert "\n" not in str(caught.value)
    assert "name resolution failed" in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_fetch_is_cached_by_query_and_checksum(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    calls: list[str | None] = []

    def download(place: str | None, box: object) -> bytes:
        calls.append(place)
        return OSM.encode()

    monkeypatch.setattr(fetching, "_download", download)
    first = fetch_extract(tmp_path, name=None, place="Arbat, Moscow", box=None)
    second = fetch_extract(tmp_path, name=None, place="Arbat, Moscow", box=None)
    assert (first.cached, second.cached) == (False, True)
    assert first.path.name == "arbat-moscow.osm.gz"
    first.path.write_bytes(b"spoilt")
    third = fetch_extract(tmp_path, name=None, place="Arbat, Moscow", box=None)
    assert not third.cached
    assert third.sha256 == first.sha256
    assert len(calls) == 2
