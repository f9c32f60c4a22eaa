"""Every country names its sign for each of the catalogue's; a damaged file ends in one line."""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tsbench.core.errors import InputError
from tsbench.signs.catalog import load_catalog
from tsbench.signs.countries import Country, load_countries, load_country, shown_code, write_csv
from tsbench.signs.sheet import draw_sheet

COUNTRIES = load_countries()


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


def test_countries_are_no_part_of_what_is_judged(edited: Callable[[str, str, str], Path]) -> None:
    root = edited("countries/de.yaml", 'code: "205"', 'code: "999"')
    assert load_country("de", root).equivalents["2.4"].code == "999"
    assert load_catalog(root).judged(["2.4"]) == load_catalog().judged(["2.4"])


def test_a_caption_shows_the_country_s_code_in_latin_letters() -> None:
    assert shown_code("2.4", None) == "2.4"
    assert shown_code("2.4", load_country("de")) == "DE 205"
    assert shown_code("4.2.3", load_country("de")) == "4.2.3 (DE: none)"
    assert shown_code("2.4", load_country("cn")) == "CN Jin 2"
    for country in COUNTRIES:
        assert all(shown_code(sign, country).isascii() for sign in country.equivalents)


def test_the_sheet_of_a_country_differs_below_the_plates_only() -> None:
    own = np.asarray(draw_sheet(load_catalog()))
    foreign = np.asarray(draw_sheet(load_catalog(), load_country("de")))
    rows = np.flatnonzero((own != foreign).any(axis=(1, 2)))
    first_band = rows[rows < 250]  # title 44 px, plate 8 + 120 px, code from 14 px below
    assert first_band.min() >= 28 + 44 + 128
    assert first_band.max() < 28 + 44 + 120 + 37


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
        ("schema: 1", "schema: 2", "schema: is 2"),
        ("country: de", "country: fr", "country: 'fr' stands in the file of 'de'"),
        ("published_percent: 91", "published_percent: 191", "published_percent: must lie between"),
        ("published_percent: 91", "published_percent: 91\ncolour: red", "colour: unknown key"),
        ('  "2.4":\n', '  "2.9":\n', "signs: 2.9: the catalogue has no such sign"),
        ('code: "205"\n    checked: true', 'code: "205"', "signs: 2.4: checked: is missing"),
        (
            'code: "205"\n    checked: true',
            'code: "205"\n    checked: 1',
            "2.4: checked: must be true or false",
        ),
        ('code: "205"', "code: 205", "signs: 2.4: code: must be text"),
        ('code: "205"', 'code: "205"\n    reason: x', "signs: 2.4: reason: goes with code: none only"),
        ('code: "205"', "code: none", "signs: 2.4: reason: is missing"),
        ('code: "205"', 'code: "205"\n    colour: red', "signs: 2.4: colour: unknown key"),
        ('code: "205"', 'code: "示1"', "signs: 2.4: code '示1' needs its letters under latin"),
    ],
)
def test_damage_is_one_line(edited: Callable[[str, str, str], Path], old: str, new: str, said: str) -> None:
    root = edited("countries/de.yaml", old, new)
    with pytest.raises(InputError) as error:
        load_country("de", root)
    assert said in str(error.value)
    assert str(root / "countries" / "de.yaml") in str(error.value)
    assert "\n" not in str(error.value)


def test_an_unknown_country_names_the_known_ones(catalog_copy: Path) -> None:
    with pytest.raises(InputError, match="no country 'xx': it has cn, de, fr, gb, it, tr"):
        load_country("xx")
    for path in (catalog_copy / "countries").iterdir():
        path.unlink()
    with pytest.raises(InputError, match="no YAML files here"):
        load_countries(catalog_copy)
