"""`tsbench signs` prints the catalogue and draws it."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from PIL import Image

from tsbench.cli.maps import maps
from tsbench.cli.signs import signs
from tsbench.core.errors import InputError
from tsbench.make.maps.extracts import parse_box
from tsbench.signs.catalog import load_catalog
from tsbench.signs.countries import load_countries


def call(*arguments: str) -> Result:
    return CliRunner(env={"COLUMNS": "120"}).invoke(signs, arguments)


def test_list_names_every_sign_and_type() -> None:
    printed = call("list").output
    for sign in load_catalog().signs.values():
        assert sign.code in printed
        assert sign.type_id in printed
    assert "34 signs, 29 scenario types" in printed


def test_list_keeps_type_ids_whole_on_a_narrow_terminal() -> None:
    printed = CliRunner(env={"COLUMNS": "80"}).invoke(signs, ["list"]).output
    assert "direction_straight_right" in printed
    assert max(map(len, printed.splitlines())) <= 80
    assert "…" not in printed


@pytest.mark.parametrize("code", list(load_catalog().signs))
def test_show_prints_facts_thresholds_and_clauses(code: str) -> None:
    result = call("show", code)
    sign = load_catalog().sign(code)
    assert result.exit_code == 0
    for text in (sign.name_ru, sign.name_en, "Appendix 1", "52290", "Annex 1", *sign.rule.thresholds):
        assert text in result.output
    for clause in sign.rule.clauses:
        assert clause.id in result.output


def test_show_of_an_unknown_code_is_bad_input() -> None:
    assert isinstance(call("show", "9.9").exception, InputError)


def test_sheet_draws_a_png(tmp_path: Path) -> None:
    path = tmp_path / "new" / "sheet.png"
    assert call("sheet", "--out", str(path)).output.strip() == str(path)
    with Image.open(path) as picture:
        assert picture.format == "PNG"
        assert picture.width > 1000
        assert len(picture.getcolors(1 << 20) or []) > 50


def test_a_sheet_that_cannot_be_written_is_bad_input(tmp_path: Path) -> None:
    assert isinstance(call("sheet", "--out", str(tmp_path / "sheet.jpg")).exception, InputError)
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    assert isinstance(call("sheet", "--out", str(tmp_path / "file" / "sheet.png")).exception, InputError)


def test_equivalents_of_all_countries_and_of_one(tmp_path: Path) -> None:
    printed = call("equivalents").output
    for country in load_countries():
        assert f"{country.count}/34" in printed
        assert f"{country.published_percent:g} %" in printed
    path = tmp_path / "de.csv"
    one = call("equivalents", "--country", "de", "--csv", str(path)).output
    assert "220-20" in one
    assert "memory" in one
    assert str(path) in one
    assert len(path.read_text(encoding="utf-8").splitlines()) == 35
    assert isinstance(call("equivalents", "--country", "xx").exception, InputError)


def test_equivalents_as_tables_of_a_paper(tmp_path: Path) -> None:
    assert call("equivalents", "--out", str(tmp_path)).exit_code == 0
    assert call("equivalents", "--country", "de", "--out", str(tmp_path)).exit_code == 0
    rows = list(csv.DictReader((tmp_path / "countries.csv").read_text(encoding="utf-8").splitlines()))
    for row, country in zip(rows, load_countries(), strict=True):
        assert (row["country"], int(row["equivalents"]), row["signs"]) == (country.code, country.count, "34")
    one = list(csv.DictReader((tmp_path / "country-de.csv").read_text(encoding="utf-8").splitlines()))
    assert len(one) == 34
    assert "220-20" in (tmp_path / "country-de.tex").read_text(encoding="utf-8")


OSM = """<?xml version="1.0"?><osm version="0.6">
<node id="1" version="1" lat="55.80" lon="37.40"/><node id="2" version="1" lat="55.801" lon="37.40"/>
<way id="9" version="1"><nd ref="1"/><nd ref="2"/><tag k="highway" v="residential"/></way></osm>"""


def call_maps(*arguments: str) -> str:
    done = CliRunner().invoke(maps, list(arguments))
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done.output


def test_convert(tmp_path: Path) -> None:
    (tmp_path / "one.osm").write_text(OSM)
    said = call_maps("convert", str(tmp_path / "one.osm"), "--out", str(tmp_path / "new" / "one.net.xml"))
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


def test_stats_of_the_committed_pool(tmp_path: Path) -> None:
    said = call_maps("stats", "--png", str(tmp_path / "map.png"))
    assert "Maps by family and shape" in said
    assert (tmp_path / "map.png").stat().st_size > 10_000


@pytest.mark.parametrize("box", ["1,2,3", "a,b,c,d", "37.7,55.7,37.6,55.8", "30,50,40,60"])
def test_a_bad_box_is_one_line(box: str) -> None:
    with pytest.raises(InputError, match="--bbox"):
        parse_box(box)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["convert", "none.osm", "--out", "one.net.xml"], "no such file"),
        (["harvest", "--osm", ".", "--out", "pool.parquet"], "no OSM extract"),
        (["show", "j-nowhere-0", "--out", "x.png"], "j-nowhere-0: no such map"),
    ],
)
def test_maps_that_are_not_there(
    arguments: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=said):
        call_maps(*arguments)
