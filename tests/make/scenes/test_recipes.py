"""Recipes: read as they stand, refused with file and key."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from command_line import one_line

from tsbench.core.errors import InputError
from tsbench.make.placements.by_name import placement_of
from tsbench.make.scenes.recipe import load_recipe, recipe_types, recipes_folder
from tsbench.signs.catalog import load_catalog
from tsbench.sim.world import DT_S


def test_every_type_has_a_recipe() -> None:
    assert sorted(recipe_types()) == sorted(kind.id for kind in load_catalog().every_type)


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
    with one_line(str(path)) as said:
        load_recipe(name, load_catalog(), folder)
    return said[0]


@pytest.fixture
def good() -> dict:
    return yaml.safe_load((recipes_folder() / "yield.yaml").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("colour", "red", "colour: unknown key"),
        ("type", "stop", "type: 'stop' stands in the file of 'yield'"),
        ("maps", {"T": 42}, "maps: T: must be a whole number that's a multiple of 4, not 42"),
        ("maps", {"T": 0}, "maps: T: must be a whole number >= 4, not 0"),
        ("numbers", {"gap_m": True}, "numbers: gap_m: must be a whole number or a number, not True"),
        ("numbers", {"gap_m": -1}, "numbers: gap_m: must be a number >= 0.0, not -1"),
        ("numbers", {"walk_mps": 0}, "numbers: walk_mps: must be a number >= 0.1, not 0"),
        ("numbers", {"brake_mps2": 70}, "numbers: brake_mps2: must be a number <= 10.0, not 70"),
        ("numbers", {"meet_share": 1.1}, "numbers: meet_share: must be a number <= 1.0, not 1.1"),
        ("numbers", {"least_lanes": 1.5}, "numbers: least_lanes: must be a whole number, not 1.5"),
        ("numbers", {"a_least_m": 9, "a_most_m": 5}, "numbers: a_least_m: 9 is more than a_most_m, 5"),
        ("horizon", 5, "horizon: must be a whole number >= 10, not 5"),
        ("choices", {"users": []}, "choices: users: must be a list of length >= 1, not []"),
        ("choices", {"users": [0]}, "choices: users: number 1: must be a whole number >= 1, not 0"),
        ("choices", {"limits_kmh": [500]}, "choices: limits_kmh: number 1: must be a number <= 200.0, not 500"),
        ("choices", {"presets": [{"count": "x"}]}, "choices: presets: number 1: count: must be a whole number"),
        ("choices", {"presets": [{"colour": 1}]}, "choices: presets: number 1: colour: unknown key"),
        ("choices", {"main_plates": [2.1]}, "choices: main_plates: number 1: must be text, not 2.1"),
    ],
)
def test_a_wrong_recipe(tmp_path: Path, good: dict, key: str, value: object, words: str) -> None:
    assert words in refuse(tmp_path, yaml.safe_dump(change(good, key, value)))


def test_a_type_without_a_recipe(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no sheet of the type 'stop'"):
        load_recipe("stop", load_catalog(), tmp_path)


def test_an_unknown_placement(tmp_path: Path, good: dict) -> None:
    (tmp_path / "yield.yaml").write_text(yaml.safe_dump(good | {"placement": "by_feel"}), encoding="utf-8")
    recipe = load_recipe("yield", load_catalog(), tmp_path)
    with pytest.raises(InputError, match=r"yield\.yaml: placement: unknown 'by_feel'"):
        placement_of(recipe)
