"""Cities as data: those that are described, and what is wrong with a description or an extract in one line."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from pool_builders import row

from tsbench.core.benchmark import MAPS
from tsbench.core.errors import InputError
from tsbench.core.paths import CITY, SHIPPED_CITIES, cities_folder, city_names, data_root
from tsbench.make.city import extract_info, fetch_extracts, list_extracts, load_city, netconvert_file, types_file
from tsbench.make.maps.plain import class_speeds
from tsbench.make.scenes.overview import carried
from tsbench.make.scenes.recipe import load_recipe
from tsbench.scenarios.certificates import certificates_of
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.catalog import load_catalog


@pytest.mark.parametrize("name", city_names())
def test_every_city_names_a_type_map_and_where_its_extracts_are(name: str) -> None:
    city = load_city(name)
    town = DataSet.named(name)
    assert types_file(town).is_file()
    assert all(e.address.startswith("https://") and e.licence == "ODbL-1.0" for e in city.extracts)
    assert set(city.maps) <= set(MAPS)
    assert city.split.rest in city.maps


def test_codes_of_extracts_are_of_one_city() -> None:
    codes = [extract.code for name in city_names() for extract in load_city(name).extracts]
    assert len(set(codes)) == len(codes)


def test_moscow_is_what_the_benchmark_has() -> None:
    city = load_city("moscow")
    assert (city.maps, city.zone, len(city.extracts)) == (MAPS, 37, 7)
    assert (len(city.split.holdout), len(city.split.dev), city.split.rest) == (16, 7, "train")


@pytest.fixture
def described(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """Writes north-bayreuth's description with changes, as a city of its own, and gives its name."""
    content = yaml.safe_load((cities_folder() / "north-bayreuth.yaml").read_text())
    monkeypatch.setattr("tsbench.make.city.cities_folder", lambda: tmp_path)

    def write(changes: dict[str, Any], name: str = "here") -> str:
        changed = {**content, "city": name, **changes}
        (tmp_path / f"{name}.yaml").write_text(yaml.safe_dump({k: v for k, v in changed.items() if v is not None}))
        return name

    return write


EXTRACT = {
    "name": "a", "code": "a", "well_tagged": True, "date": "2014-11", "address": "https://x", "sha256": "0" * 64,
    "bytes": 4, "licence": "ODbL-1.0",
}  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"side": "left"}, "side: left: traffic keeps to the right in 'de'"),
        ({"country": "gb"}, "side: right: traffic keeps to the left in 'gb'"),
        ({"country": "GB"}, "side: right: traffic keeps to the left in 'gb'"),
        ({"country": "ie"}, "side: right: traffic keeps to the left in 'ie'"),
        ({"country": "in"}, "side: right: traffic keeps to the left in 'in'"),
        ({"country": "nl", "side": "left"}, "side: left: traffic keeps to the right in 'nl'"),
        ({"country": "uk"}, "country: 'uk' is no country's code: write its two letters of ISO 3166, such as de, or gb"),
        ({"country": "zz"}, "country: 'zz' is no country's code"),
        ({"country": ""}, "country: '' is no country's code"),
        ({"country": "deu"}, "country: 'deu' is no country's code"),
        ({"country": " de"}, "country: ' de' is no country's code"),
        ({"zone": 0}, "zone: must be a whole number >= 1, not 0"),
        ({"zone": 61}, "zone: must be a whole number <= 60, not 61"),
        ({"lanes": 2}, "lanes: unknown key"),
        ({"schema": 2}, "schema: is 2, this version reads 1"),
        ({"city": "there"}, "city: 'there' stands in the file of 'here'"),
        ({"maps": {"tets": 5}}, "maps: expected numbers for some of"),
        ({"maps": {}}, "maps: expected numbers for some of"),
        ({"maps": {"test": 0}}, "maps: test: must be a whole number >= 1, not 0"),
        ({"maps": {"test": 81}}, "maps: test: must be a whole number <= 80, not 81"),
        ({"split": {"tile_m": 499, "test_share": 0.5}}, r"split: tile_m: must be a number >= 500\.0, not 499"),
        ({"split": {"tile_m": 1000, "test_share": 1.01}}, r"split: test_share: must be a number <= 1\.0, not 1\.01"),
        ({"split": {"tile_m": 1000, "test_share": 0.5, "dev": [[1]]}}, "dev: number 1: must be a list of length 2"),
        ({"extracts": []}, "extracts: must be a list of length >= 1"),
        ({"extracts": [{**EXTRACT, "date": 2014}]}, "extracts: number 1: date: must be text, not 2014"),
        ({"extracts": [{**EXTRACT, "sha256": "0" * 63}]}, "sha256: must be 64 digits"),
        ({"extracts": [{**EXTRACT, "bytes": 0}]}, "bytes: must be a whole number >= 1"),
        ({"extracts": [EXTRACT, {**EXTRACT, "name": "b"}]}, "the same code stands twice"),
    ],
)
def test_a_wrong_description_is_one_line(described: Callable[..., str], changes: dict[str, Any], says: str) -> None:
    name = described(changes)
    with pytest.raises(InputError, match=says) as caught:
        load_city(name)
    assert str(caught.value).count("here.yaml") == 1


def test_the_bounds_themselves_are_fine(described: Callable[..., str]) -> None:
    found = load_city(described({"zone": 60, "maps": {"dev": 1}, "split": {"tile_m": 500, "test_share": 0.0}}))
    assert (found.zone, found.maps, found.split.test_share) == (60, {"dev": 1}, 0.0)


def test_a_town_may_have_its_country_s_speeds(described: Callable[..., str]) -> None:
    town = DataSet.named(described({"types": "country", "country": "at"}))
    here = class_speeds(types_file(town))
    made = types_file(town).read_bytes()
    assert types_file(town).read_bytes() == made
    town = class_speeds(netconvert_file("town.typ.xml"))
    changed = {road: (town[road], speed) for road, speed in here.items() if speed != town[road]}
    assert changed == {
        "highway.living_street": (5.56, 1.39), "highway.trunk": (22.22, 27.78), "highway.motorway": (27.78, 36.11),
    }  # fmt: skip


def test_speeds_of_a_country_that_has_no_file_are_not_invented(described: Callable[..., str]) -> None:
    with pytest.raises(InputError, match="types: no speeds are known of 'nl'"):
        load_city(described({"types": "country", "country": "nl"}))


@pytest.mark.parametrize(
    ("country", "code", "side"), [("DE", "de", "right"), ("Ie", "ie", "left"), ("no", "no", "right")]
)
def test_a_country_s_code_in_any_case(described: Callable[..., str], country: str, code: str, side: str) -> None:
    city = load_city(described({"country": country, "side": side, "types": "town.typ.xml"}))
    assert (city.country, city.side, city.frame.mirrored) == (code, side, side == "left")


def test_a_city_that_nobody_described() -> None:
    with pytest.raises(InputError, match=r"atlantis\.yaml: no such city; there are .*moscow"):
        load_city("atlantis")


@pytest.mark.parametrize("name", ["../moscow", "a/b", "Moscow", "-a", "a.b"])
def test_a_name_leads_nowhere_else(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="a city's name is of a-z, 0-9 and '-'"):
        DataSet.named(name)
    monkeypatch.setenv(CITY, name)
    with pytest.raises(InputError, match="a city's name is of a-z, 0-9 and '-'"):
        DataSet.driven()


def test_a_city_has_its_own_data(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(CITY, raising=False)
    assert DataSet.driven().file("scenarios/test.parquet") == data_root() / "scenarios" / "test.parquet"
    monkeypatch.setenv(CITY, "krems")
    krems = DataSet.driven()
    # What the city does not have is not Moscow's.
    assert krems.file("scenarios/test.parquet") == data_root() / "cities/data/krems/scenarios/test.parquet"
    assert (krems.name, extract_info(krems, "krems").code) == ("krems", "kre")
    assert DataSet.driven("andorra").name == "andorra"


@pytest.mark.parametrize("name", SHIPPED_CITIES)
def test_every_row_of_a_town_is_certified_by_a_second_process(name: str) -> None:
    town = DataSet.named(name)
    rows = [r for split in town.splits for r in town.table(split)]
    proofs = {c.scenario_id: c for c in certificates_of(town)}
    assert proofs.keys() == {r.scenario_id for r in rows}
    for r in rows:
        c = proofs[r.scenario_id]
        assert (c.solvable, c.sane, c.reproduced, c.split) == (True, True, True, r.split), c


def test_only_the_citys_own_extracts_are_taken_and_only_as_they_were(tmp_path: Path) -> None:
    town = DataSet.named("krems")
    with pytest.raises(InputError, match=r"no extract 'krems' here .*it is at https://raw"):
        list_extracts(town, tmp_path)
    (tmp_path / "krems.osm.pbf").write_bytes(b"another state")
    with pytest.raises(InputError, match=r"krems\.osm\.pbf: SHA-256 [0-9a-f]{64} is not that of 'krems'"):
        list_extracts(town, tmp_path)


def test_strangers_in_the_folder_do_not_matter(described: Callable[..., str], tmp_path: Path) -> None:
    import hashlib

    folder = tmp_path / "osm"
    folder.mkdir()
    (folder / "a.osm").write_bytes(b"mine")
    shutil.copy(folder / "a.osm", folder / "b.osm")
    name = described({"extracts": [{**EXTRACT, "sha256": hashlib.sha256(b"mine").hexdigest()}]})
    town = DataSet.named(name)
    assert list_extracts(town, folder) == [folder / "a.osm"]


def test_an_extract_is_fetched_once_whatever_its_ending(described: Callable[..., str], tmp_path: Path) -> None:
    import hashlib

    content = b"<osm/>"
    (tmp_path / "st.gallen-2013.01.osm.xml").write_bytes(content)
    digest = hashlib.sha256(content).hexdigest()
    address = str(tmp_path / "st.gallen-2013.01.osm.xml")
    entry = {**EXTRACT, "name": "st.gallen", "address": address, "sha256": digest, "bytes": len(content)}
    name, folder = described({"extracts": [entry]}), tmp_path / "osm"
    told: list[str] = []
    fetch_extracts(name, folder, told.append)
    assert [path.name for path in folder.iterdir()] == ["st.gallen.osm.xml"]
    # Who has it under another ending needs no second one, which would be refused.
    (folder / "st.gallen.osm.xml").rename(folder / "st.gallen.OSM")
    fetch_extracts(name, folder, told.append)
    assert [path.name for path in folder.iterdir()] == ["st.gallen.OSM"]
    assert [line.split(": ")[0] for line in told] == [f"{folder}/st.gallen.osm.xml", f"{folder}/st.gallen.OSM"]
    town = DataSet.named(name)
    assert list_extracts(town, folder) == [folder / "st.gallen.OSM"]


def test_why_a_town_carries_no_more_of_a_type(described: Callable[..., str]) -> None:
    city = load_city(described({"split": {"tile_m": 1000, "test_share": 1.0}, "maps": {"test": 2, "dev": 1}}))
    pool = [row("j-1", "junction", "T"), row("j-2", "junction", "T", east=5000.0)]
    catalog = load_catalog()
    recipes = [load_recipe(type_id, catalog) for type_id in ("yield", "roundabout", "main_road")]
    report = [
        {"type_id": "yield", "split": "test", "maps": {"T": 1}, "reasons": {"the arm is # m long": 1}},
        {"type_id": "main_road", "split": "test", "maps": {"T": 2}, "reasons": {"the arm is # m long": 1}},
    ]
    found = {(c.type_id, c.split): (c.there, c.maps, c.wanted, c.why) for c in carried(city, pool, recipes, report)}
    assert found["yield", "test"] == (2, 1, 2, "1 the arm is … m long")
    assert found["main_road", "test"] == (2, 2, 2, "")
    assert found["yield", "dev"] == (0, 0, 1, "no junction of T, X in its tiles")
    assert found["roundabout", "test"] == (0, 0, 2, "no roundabout of ring in its tiles")
    assert [c.why for c in carried(city, pool, recipes[:1], []) if c.split == "test"] == ["not built yet"]
