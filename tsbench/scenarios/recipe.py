"""Recipes: one YAML per scenario type under `scenarios/recipes/`; the numbers of a scene, none of them in code."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from tsbench.errors import InputError
from tsbench.paths import data_file
from tsbench.signs.catalog import Catalog, ScenarioType

SCHEMA_VERSION = 1
_KEYS = {"schema", "type", "placement", "horizon", "maps", "numbers", "choices"}
_MAY = {"tempted", "breaker"}


@dataclass(frozen=True)
class Recipe:
    """How scenes of one type are arranged.

    placement: name of the placement (scenarios.families). maps: how many maps of which stratum, keys such as "T" or
    "straight/2", for the train split and a quarter of it for test. numbers: lengths in m, speeds in m/s, times in s,
    as their names say. choices: lists to draw from. tempted: the sign-blind driver whom the scene has to tempt
    (docs/spec/scenes.md, "Certification"). breaker: a driver whom a draw should show breaking the rule, "" = nobody;
    asked for where traffic often ends that driver's episode first.
    """

    type: ScenarioType
    placement: str
    horizon: int
    maps: dict[str, int]
    numbers: dict[str, float]
    choices: dict[str, list[Any]]
    tempted: str = "idm"
    breaker: str = ""

    def number(self, name: str) -> float:
        """One of the recipe's numbers. Raises InputError where the recipe lacks it."""
        if name not in self.numbers:
            raise InputError(f"scenarios/recipes/{self.type.id}.yaml: numbers: {name} is missing")
        return self.numbers[name]


def recipes_folder() -> Path:
    """Where the recipes stand."""
    return data_file("scenarios/recipes")


def load_recipe(type_id: str, catalog: Catalog, folder: Path | None = None) -> Recipe:
    """The recipe of a type. Raises InputError (file, key, problem)."""
    path = (folder or recipes_folder()) / f"{type_id}.yaml"
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no recipe for type {type_id!r}") from None
    except yaml.YAMLError as error:
        raise InputError(f"{path}: {' '.join(str(error).split())}") from None
    if not isinstance(data, dict) or set(data) - _MAY != _KEYS:
        raise InputError(f"{path}: expected the keys {', '.join(sorted(_KEYS))}")
    if data["schema"] != SCHEMA_VERSION or data["type"] != type_id:
        raise InputError(
            f"{path}: schema {data['schema']!r} or type {data['type']!r} is not what was asked for"
        )
    for key, value in data["maps"].items():
        if not isinstance(value, int) or value < 4 or value % 4:
            raise InputError(
                f"{path}: maps: {key}: {value!r} is no multiple of 4 (test has a quarter of train's maps)"
            )
    for key, value in data["numbers"].items():
        if not isinstance(value, int | float) or isinstance(value, bool):
            raise InputError(f"{path}: numbers: {key}: {value!r} is not a number")
    return Recipe(
        type=catalog.type(type_id),
        placement=str(data["placement"]),
        horizon=int(data["horizon"]),
        maps={str(k): int(v) for k, v in data["maps"].items()},
        numbers={str(k): float(v) for k, v in data["numbers"].items()},
        choices={str(k): list(v) for k, v in data["choices"].items()},
        tempted=str(data.get("tempted", "idm")),
        breaker=str(data.get("breaker", "")),
    )


def recipe_types(folder: Path | None = None) -> tuple[str, ...]:
    """Types that have a recipe, sorted."""
    return tuple(sorted(p.stem for p in (folder or recipes_folder()).glob("*.yaml")))
