"""Every country names its sign for each of the catalogue's; a damaged file ends in one line."""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_line import one_line

from tsbench.core.errors import InputError
from tsbench.core.paths import OWN_CITY
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.catalog import load_catalog
from tsbench.signs.countries import Artwork, Country, load_countries, load_country, write_csv
from tsbench.signs.plates import draw_sheet, plate_rgba

COUNTRIES, OWN = load_countries(), Artwork(load_catalog())


@pytest.mark.parametrize("country", COUNTRIES, ids=lambda country: country.code)
def test_a_country_covers_the_catalogue_in_its_order(country: Country) -> None:
    assert list(country.equivalents) == list(load_catalog().signs)
    assert all(entry.code != "unknown" for entry in country.equivalents.values())
    for sign, entry in country.equivalents.items():
        assert entry.exists == (entry.reason is None), sign
    absent = [entry for entry in country.equivalents.values() if entry.code == "none"]
    assert (country.count, country.known) == (34 - len(absent), 34)
    assert country.percent == pytest.approx(100 * (34 - len(absent)) / 34)
    assert country.checked == sum(entry.checked for entry in country.equivalents.values())


def test_codes_that_the_law_texts_give() -> None:
    expected = {
        "de": {"2.4": "205", "4.1.2": "209", "4.2.1": "222", "5.7.1": "220-20", "4.2.3": "none"},
        "fr": {"4.1.5": "B21d2", "4.2.1": "B21a1", "5.21": "B52", "4.2.3": "none"},
        "it": {"2.4": "II.36", "2.5": "II.37", "4.2.1": "II.82/b", "4.2.2": "II.82/a", "4.2.3": "II.83"},
        "tr": {"2.4": "TT-1", "2.5": "TT-2", "4.1.1": "TT-35c", "4.2.3": "TT-36c"},
        "gb": {"2.5": "601.1", "3.1": "616", "3.18.1": "612", "3.18.2": "613"},
    }
    for code, signs in expected.items():
        country = load_country(code)
        for sign, equivalent in signs.items():
            assert country.equivalents[sign].code == equivalent, (code, sign)


def test_left_and_right_have_codes_of_their_own_or_a_note_that_tells_them_apart() -> None:
    for country in COUNTRIES:
        for right, left in (("3.18.1", "3.18.2"), ("4.1.2", "4.1.3"), ("4.2.1", "4.2.2"), ("5.7.1", "5.7.2")):
            one, other = country.equivalents[right], country.equivalents[left]
            assert (one.code, one.note) != (other.code, other.note), (country.code, right)


def asked(code: str) -> Artwork:
    return Artwork.of(load_catalog(), OWN_CITY, load_country(code))


def test_a_caption_shows_the_country_s_code_in_latin_letters() -> None:
    assert OWN.code("2.4") == "2.4"
    assert asked("de").code("2.4") == "DE 205"
    assert asked("de").code("4.2.3") == "4.2.3 (DE: none)"
    assert asked("cn").code("2.4") == "CN Jin 2"
    for country in COUNTRIES:
        assert all(asked(country.code).code(sign).isascii() for sign in country.equivalents)


def test_a_plate_is_the_country_s_where_that_has_a_drawing() -> None:
    """The bus lane is a disc in Germany; a limit looks the same, and counts miles in the United Kingdom."""
    de, gb = asked("de"), asked("gb")
    assert not np.array_equal(plate_rgba(de, "5.14.1", None, 96), plate_rgba(OWN, "5.14.1", None, 96))
    assert np.array_equal(plate_rgba(de, "2.3.2", None, 96), plate_rgba(OWN, "2.3.1", None, 96))
    assert np.array_equal(plate_rgba(de, "3.24", 50.0, 96), plate_rgba(OWN, "3.24", 50.0, 96))
    assert not np.array_equal(plate_rgba(gb, "3.24", 50.0, 96), plate_rgba(OWN, "3.24", 50.0, 96))
    assert gb.country is not None
    assert gb.country.traffic is not None
    assert [gb.country.posted(kmh) for kmh in (10.0, 20.0, 30.0, 50.0, 60.0, 110.0)] == [10, 10, 20, 30, 40, 70]
    assert gb.country.posted(1.0) == 10.0, "there is no plate of 0"
    assert gb.value(50.0) == "30 mph for 50 km/h"
    assert (gb.country.traffic.speeds_mps["residential"], gb.country.traffic.speeds_mps["motorway"]) == (13.41, 31.29)
    assert de.value(50.0) == OWN.value(50.0) == "50"


@pytest.mark.parametrize("code", ["ad", "at", "de", "gb"])
def test_all_plates_of_a_country_can_be_drawn(code: str) -> None:
    country = load_country(code)
    assert (country.traffic.side == "left") == (code == "gb")
    for sign in load_catalog().signs.values():
        printed = sign.value.allowed if sign.value is not None and sign.value.printed else (None,)
        for value in printed:
            assert plate_rgba(asked(code), sign.code, value, 48)[..., 3].max() == 255, (sign.code, value)


def test_every_drawing_of_a_country_is_somebody_s() -> None:
    plates = load_catalog().root / "plates"
    named = {e.drawing for country in COUNTRIES for e in country.equivalents.values()}
    there = {f"{p.parent.name}/{p.name}" for p in plates.glob("*/*.svg") if p.parent.name != "left"}
    assert there <= named


def test_scenes_of_a_city_are_signed_with_its_country_s_plates() -> None:
    """Cities are asked in turn, in one process."""
    names = (OWN_CITY, "north-bayreuth", "krems", "mirrored-north-bayreuth")
    own, german, austrian, mirrored = (DataSet.named(name).artwork() for name in names)
    for _ in range(2):
        assert own.country is None, "Russia has no file: its plates are the catalogue's"
        assert german.country == load_country("de")
        assert [own.code("2.4"), german.code("2.4"), german.code("4.2.3")] == ["2.4", "DE 205", "4.2.3"]
        bus = plate_rgba(own, "5.14.1", None, 96)
        assert np.array_equal(plate_rgba(german, "5.14.1", None, 96), plate_rgba(asked("de"), "5.14.1", None, 96))
        assert not np.array_equal(plate_rgba(german, "5.14.1", None, 96), bus)
        # Austria's are drawn as Germany's, and have no numbers yet.
        assert austrian.code("2.4") == "2.4"
        assert not np.array_equal(plate_rgba(austrian, "5.14.1", None, 96), bus)
        # In a mirror a ring's arrows go round the other way, whose plates they may be.
        assert not np.array_equal(plate_rgba(mirrored, "4.3", None, 96), plate_rgba(german, "4.3", None, 96))


def test_the_sheet_of_a_country_shows_its_plates() -> None:
    own = np.asarray(draw_sheet(OWN))
    foreign = np.asarray(draw_sheet(asked("de")))
    assert own.shape == foreign.shape
    rows = np.flatnonzero((own != foreign).any(axis=(1, 2)))
    # Of the first band of plates two are 301 here; below them all codes differ.
    assert rows.min() < 28 + 44 + 128


def test_csv_holds_every_entry(tmp_path: Path) -> None:
    path = tmp_path / "new" / "all.csv"
    write_csv(load_catalog(), COUNTRIES, path)
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 6 * 34
    first = next(row for row in rows if row["country"] == "de" and row["sign"] == "4.2.3")
    assert (first["equivalent"], first["checked"]) == ("none", "false")
    assert first["reason"]
    with pytest.raises(InputError, match=r"all\.csv"):
        write_csv(load_catalog(), COUNTRIES, path / "x.csv")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("country: de", "country: fr", "country: 'fr' stands in the file of 'de'"),
        ('  "2.4":\n', '  "2.9":\n', "signs: 2.9: the catalogue has no such sign"),
        ('code: "205"', 'code: "205"\n    reason: x', "signs: 2.4: reason: goes with code: none only"),
        ('code: "205"', "code: none", "signs: 2.4: reason: is missing"),
        ('code: "205"', 'code: "205"\n    drawing: none.svg', "signs: 2.4: drawing: no none.svg in "),
        (
            "    code: none\n",
            "    code: none\n    drawing: 2.4.svg\n",
            "drawing: there is no such sign, so nothing to draw",
        ),
        ("residential: 50", "footway: 5", "traffic: speeds: key 'footway': 'footway' is none of"),
        ("residential: 50", "residential: 0", "traffic: speeds: residential: must be a number > 0.0, not 0"),
        ("traffic:\n", "plates: xx\ntraffic:\n", "plates: no country 'xx'"),
        ('code: "205"', 'code: "示1"', "signs: 2.4: code '示1' needs its letters under latin"),
    ],
)
def test_damage_is_one_line(edited: Callable[[str, str, str], Path], old: str, new: str, said: str) -> None:
    root = edited("countries/de.yaml", old, new)
    with one_line(said, str(root / "countries" / "de.yaml")):
        load_country("de", root)


def test_an_unknown_country_names_the_known_ones(catalog_copy: Path) -> None:
    with pytest.raises(InputError, match="no country 'xx': it has ad, at, cn, de, fr, gb, it, tr"):
        load_country("xx")
    for path in (catalog_copy / "countries").iterdir():
        path.unlink()
    with pytest.raises(InputError, match="no YAML files here"):
        load_countries(catalog_copy)
