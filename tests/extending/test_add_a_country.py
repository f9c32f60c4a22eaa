"""A country: one YAML, as far as somebody knows its signs, and drawings. docs/signs.md, "Country equivalents"."""

from __future__ import annotations

import pytest
from command_line import in_process
from data_folder import in_force
from own_copy import Copy
from PIL import Image, ImageChops

POLAND = """
schema: 1
country: pl
names: {en: Poland, own: Polska}
numbering: "Rozporządzenie w sprawie znaków i sygnałów drogowych, 2002"
signs:
  "2.5": {code: "B-20", checked: true}
  "4.2.3": {code: none, reason: no sign leaves both sides open, checked: false}
"""


def test_a_country_is_one_file_that_may_leave_signs_out(clone: Copy) -> None:
    clone.write("sign_catalog/countries/pl.yaml", POLAND)
    lines = clone.tsbench(
        "signs equivalents",
        "signs equivalents --country pl --csv pl.csv",
        "signs equivalents --country pl --out tables",
    ).splitlines()
    line = next(one for one in lines if one.startswith("pl"))
    assert line.split()[-4:] == ["1/2", "50", "%", "1"], line  # no published share
    told = {one.split()[0]: one for one in lines if one[:1].isdigit()}
    assert "B-20" in told["2.5"]
    assert "none" in told["4.2.3"]
    assert "unknown" in told["3.24"]
    rows = (clone.root / "pl.csv").read_text(encoding="utf-8").splitlines()
    assert (len(rows), sum(",unknown," in row for row in rows)) == (35, 32)
    assert "unknown" in (clone.root / "tables" / "country-pl.csv").read_text(encoding="utf-8")


LEFT = """
schema: 1
country: ie
names: {en: Ireland, own: Éire}
numbering: "Traffic Signs Manual (RUS, RRM, W)"
plates: gb
traffic: {side: left, unit: km/h, unsigned: nobody, speeds: {residential: 50, motorway: 120}}
signs:
  "2.4": {code: RUS 026, drawing: ie/026.svg, checked: false}
"""
YIELD = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 200 200">
  <polygon points="10,20 190,20 100,176" fill="#ffffff" stroke="#c8141e" stroke-width="20"/>
</svg>
"""
SHOWN = """
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.plates import plate_svg
own, cork = DataSet().artwork(), DataSet("cork").artwork()
print(cork.code("2.4"), cork.code("2.5"), end=" ")
print(*(plate_svg(cork, *plate) != plate_svg(own, *plate) for plate in (("2.4",), ("3.24", 50.0))))
print(cork.country.traffic.side, plate_svg(cork, "4.3") != plate_svg(cork, "2.5"))
"""


def test_a_country_brings_drawings_and_its_city_is_signed_with_them(clone: Copy) -> None:
    """One YAML and a drawing: numbers, plates, units; what it does not draw looks as its neighbour's."""
    clone.write("sign_catalog/countries/ie.yaml", LEFT)
    clone.write("sign_catalog/plates/ie/026.svg", YIELD)
    clone.write("cities/cork.yaml", "schema: 1\ncity: cork\ncountry: ie\n")
    first, second = clone.python("-c", SHOWN).splitlines()
    assert first == "IE RUS 026 2.5 True False"
    assert second == "left True"


def test_pictures_say_what_is_unknown(clone: Copy) -> None:
    clone.write("sign_catalog/countries/pl.yaml", POLAND)
    clone.tsbench("signs sheet --out own.png", "signs sheet --country pl --out pl.png")
    with Image.open(clone.root / "own.png") as own, Image.open(clone.root / "pl.png") as other:
        assert own.size == other.size
        assert ImageChops.difference(own, other).getbbox() is not None
    captions = (
        "from tsbench.scenarios.data_set import DataSet; from tsbench.signs.countries import load_country; "
        "pl = DataSet().artwork(load_country('pl')); print(*map(pl.code, ('2.5', '4.2.3', '3.24')), sep='|')"
    )
    assert clone.python("-c", captions).strip() == "PL B-20|4.2.3 (PL: none)|3.24 (PL: unknown)"


def test_a_data_folder_of_one_s_own_is_named_by_the_environment(
    clone: Copy, capsys: pytest.CaptureFixture[str]
) -> None:
    clone.write("sign_catalog/countries/pl.yaml", POLAND)
    signs = in_process("signs", capsys)
    assert "Poland" not in signs("equivalents")[0]
    with in_force(clone.root):
        assert "Poland" in signs("equivalents")[0]
