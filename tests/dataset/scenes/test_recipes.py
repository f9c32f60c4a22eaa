"""Recipes: read as they stand, refused with file and key."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from tsbench.core.errors import InputError
from tsbench.dataset.placements.by_name import placement_of
from tsbench.dataset.scenes.recipe import load_recipe, recipe_types, recipes_folder
from tsbench.signs.catalog import load_catalog
from tsbench.sim.world import DT_S


def test_every_type_has_a_recipe() -> None:
    assert sorted(recipe_types()) == sorted(kind.id for kind in load_catalog().types)


@pytest.mark.parametrize("name", recipe_types())
def test_a_recipe_fits_its_type(name: str) -> None:
    recipe = load_recipe(name, load_catalog())
    assert recipe.type.id == name
    if "longest_drive_s" in recipe.numbers:
        assert recipe.horizon * DT_S >= recipe.number("longest_drive_s") / 0.8
    else:
        assert recipe.horizon == (1000 if recipe.type.family == "roundabout" else 600)
    # 80 for train, and a quarter of each stratum for test: 20.
    assert sum(recipe.maps.values()) == 80
    assert sum(n // 4 for n in recipe.maps.values()) == 20
    placement_of(recipe)


def test_numbers_are_read_by_name_or_missed_by_name() -> None:
    recipe = load_recipe("yield", load_catalog())
    assert recipe.number("ego_before_line_m") == 60.0
    with pytest.raises(InputError, match=r"scenarios/recipes/yield\.yaml: numbers: gap_m is missing"):
        recipe.number("gap_m")


def change(data: dict, key: str, value: object) -> dict:
    changed = dict(data)
    if value is None:
        del changed[key]
    else:
        changed[key] = value
    return changed


def refuse(folder: Path, text: str, name: str = "yield") -> str:
    path = folder / f"{name}.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as told:
        load_recipe(name, load_catalog(), folder)
    message = str(told.value)
    assert "\n" not in message
    assert str(path) in message
    return message


@pytest.fixture
def good() -> dict:
    return yaml.safe_load((recipes_folder() / "yield.yaml").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("horizon", None, "expected the keys"),
        ("colour", "red", "expected the keys"),
        ("schema", 2, "schema 2"),
        ("type", "stop", "type 'stop'"),
        ("maps", {"T": 42}, "maps: T: 42 is no multiple of 4"),
        ("maps", {"T": "many"}, "maps: T: 'many' is no multiple of 4"),
        ("maps", {"T": 0}, "maps: T: 0 is no multiple of 4"),
        ("numbers", {"gap_m": "wide"}, "numbers: gap_m: 'wide' is not a number"),
        ("numbers", {"gap_m": True}, "numbers: gap_m: True is not a number"),
        ("numbers", {"gap_m": -1}, "numbers: gap_m: -1 is not in 0 to 1000 m"),
        ("numbers", {"gap_m": float("nan")}, "numbers: gap_m: nan is not in 0 to 1000 m"),
        ("numbers", {"gap_m": 10**400}, "is not in 0 to 1000 m"),
        ("numbers", {"walk_mps": 0}, "numbers: walk_mps: 0 is not in 0.1 to 60 m/s"),
        ("numbers", {"brake_mps2": 70}, "numbers: brake_mps2: 70 is not in 0.1 to 10 m/s2"),
        ("numbers", {"meet_share": 1.1}, "numbers: meet_share: 1.1 is not in 0 to 1 as a share"),
        ("numbers", {"least_lanes": 1.5}, "numbers: least_lanes: 1.5 is not in 0 to 100 as a whole number"),
        ("numbers", {"a_least_m": 9, "a_most_m": 5}, "numbers: a_least_m: 9 is more than a_most_m, 5"),
        ("numbers", {1: 2}, "numbers: must be a mapping of names"),
        ("numbers", [1], "numbers: must be a mapping of names"),
        ("maps", 7, "maps: must be a mapping of names"),
        ("horizon", 5, "horizon: 5 is not in 10 to 10000 ticks"),
        ("horizon", "long", "horizon: 'long' is not a number"),
        ("placement", 7, "placement: must be text"),
        ("choices", {"users": 3}, "choices: users: must be a list of at least one"),
        ("choices", {"users": []}, "choices: users: must be a list of at least one"),
        ("choices", {"users": [0]}, "choices: users: 0 is not in 1 to 20 as a whole number"),
        ("choices", {"limits_kmh": [500]}, "choices: limits_kmh: 500 is not in 1 to 200 km/h"),
        ("choices", {"presets": [{"count": "x"}]}, "choices: presets: count: 'x' is not a number"),
        ("choices", {"presets": [{"colour": 1}]}, "choices: presets: 'colour': unknown key"),
        ("choices", {"main_plates": [2.1]}, "choices: main_plates: 2.1 is no str"),
    ],
)
def test_a_wrong_recipe(tmp_path: Path, good: dict, key: str, value: object, words: str) -> None:
    assert words in refuse(tmp_path, yaml.safe_dump(change(good, key, value)))


@pytest.mark.parametrize(
    "text", ["", "- a\n- b\n", "a: [1,\n", "\tindented: true\n", "a: " + "[" * 100_000, "1: 2001-99-99\n"]
)
def test_no_recipe_at_all(tmp_path: Path, text: str) -> None:
    refuse(tmp_path, text)


def test_a_type_without_a_recipe(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no recipe for type 'stop'"):
        load_recipe("stop", load_catalog(), tmp_path)


def test_an_unknown_placement(tmp_path: Path, good: dict) -> None:
    (tmp_path / "yield.yaml").write_text(yaml.safe_dump(good | {"placement": "by_feel"}), encoding="utf-8")
    recipe = load_recipe("yield", load_catalog(), tmp_path)
    with pytest.raises(InputError, match=r"yield\.yaml: placement: unknown 'by_feel'"):
        placement_of(recipe)
