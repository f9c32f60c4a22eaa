"""`tsbench maps` from the outside."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from tsbench.cli.maps import maps
from tsbench.core.errors import InputError
from tsbench.make.maps.extracts import parse_box

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


def test_convert_says_what_it_did_not_take(tmp_path: Path) -> None:
    odd = OSM.replace("</way>", '<tag k="maxspeed" v="5030"/><tag k="lanes" v="&#x9b;31m&#xa;two"/></way>')
    (tmp_path / "one.osm").write_text(odd)
    out = tmp_path / "one.net.xml"
    done = CliRunner().invoke(maps, ["convert", str(tmp_path / "one.osm"), "--out", str(out)])
    note, *more = done.stderr.splitlines()
    assert note == f"note: {tmp_path}/one.osm: the tag maxspeed set aside, not 3 to 150 km/h: '5030' of way 9"
    assert all(line.startswith("note: ") and line.isprintable() for line in more)
    assert done.stdout.count("\n") == 1


def test_convert_says_what_is_wrong(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        call("convert", str(tmp_path / "none.osm"), "--out", str(tmp_path / "one.net.xml"))


def test_stats_of_the_committed_pool(tmp_path: Path) -> None:
    said = call("stats", "--png", str(tmp_path / "map.png"))
    assert "Maps by family and shape" in said
    assert (tmp_path / "map.png").stat().st_size > 10_000


def test_harvest_of_an_empty_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no OSM extract"):
        call("harvest", "--osm", str(tmp_path), "--out", str(tmp_path / "pool.parquet"))


def test_show_of_an_unknown_map(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="j-nowhere-0: no such map"):
        call("show", "j-nowhere-0", "--out", str(tmp_path / "x.png"))


@pytest.mark.parametrize("box", ["1,2,3", "a,b,c,d", "37.7,55.7,37.6,55.8", "30,50,40,60"])
def test_a_bad_box_is_one_line(box: str) -> None:
    with pytest.raises(InputError, match="--bbox"):
        parse_box(box)
