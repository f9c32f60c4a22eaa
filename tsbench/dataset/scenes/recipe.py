"""Recipes: one YAML per scenario type under `scenarios/recipes/`; the numbers of a scene, none of them in code."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tsbench.core.benchmark import TEST_PER_TRAIN
from tsbench.core.errors import InputError
from tsbench.core.paths import data_file
from tsbench.core.textfile import read_yaml
from tsbench.signs.catalog import Catalog, ScenarioType

SCHEMA_VERSION = 1
_KEYS = {"schema", "type", "placement", "horizon", "maps", "numbers", "choices"}
_MAY = {"blind_baseline", "violating_baseline", "paired"}
# Least and most of a number, and its unit, by the end of its name; what has none of these ends is a count.
_RANGES = {
    "_m": (0.0, 1000.0, "m"), "_mps": (0.1, 60.0, "m/s"), "_kmh": (1.0, 200.0, "km/h"), "_mps2": (0.1, 10.0, "m/s2"),
    "_s": (0.0, 600.0, "s"), "_deg": (0.0, 180.0, "degrees"), "_share": (0.0, 1.0, "as a share"),
    "_ratio": (0.0, 10.0, "as a ratio"),
}  # fmt: skip
_COUNT = (0, 100, "as a whole number")
_TICKS = (10, 10_000, "ticks")
# Names that have to stand in order where a recipe has both.
_ORDERED = (("least", "most"), ("nearest", "farthest"))
# What an entry of a list of choices is: a range, text, a truth value, or a mapping of these.
_TRACK = (-10.0, 10.0, "m")
_PARTS: dict[str, Any] = {
    "count": (1, 20, "as a whole number"), "gap_s": _RANGES["_s"], "gap_share": _RANGES["_share"],
    "alternate": bool, "shape": str, "length_m": (0.1, 100.0, "m"), "width_m": (0.1, 20.0, "m"),
}  # fmt: skip
_CHOICES: dict[str, Any] = {
    "users": (1, 20, "as a whole number"), "limits_kmh": _RANGES["_kmh"], "contrast_kmh": _RANGES["_kmh"],
    "tracks_m": _TRACK,
    "obstacles": dict, "presets": dict,
}  # fmt: skip


@dataclass(frozen=True)
class Recipe:
    """How scenes of one type are arranged.

    placement: name of the placement (scenarios.families). maps: how many maps of which stratum, keys such as "T" or
    "straight/2", for the train split and a quarter of it for test. numbers: lengths in m, speeds in m/s, times in s,
    as their names say. choices: lists to draw from. blind_baseline: the sign-blind driver that has to break the rule
    (docs/scenes.md, "Certificates"). violating_baseline: a driver that should break it in a draw, "" = none. It
    is asked for where traffic often ends the other's episode first. paired: have its rows a contrast half?
    """

    type: ScenarioType
    placement: str
    horizon: int
    maps: dict[str, int]
    numbers: dict[str, float]
    choices: dict[str, list[Any]]
    blind_baseline: str = "idm"
    violating_baseline: str = ""
    paired: bool = False

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
    data = read_yaml(path, f"recipe for type {type_id!r}")
    if not isinstance(data, dict) or set(data) - _MAY != _KEYS:
        raise InputError(f"{path}: expected the keys {', '.join(sorted(_KEYS))}")
    for key in ("maps", "numbers", "choices"):
        if not isinstance(data[key], dict) or not all(isinstance(name, str) for name in data[key]):
            raise InputError(f"{path}: {key}: must be a mapping of names")
    if not isinstance(data.get("paired", False), bool):
        raise InputError(f"{path}: paired: must be true or false, not {data['paired']!r:.80}")
    for key in ("placement", *sorted(_MAY - {"paired"} & set(data))):
        if not isinstance(data[key], str):
            raise InputError(f"{path}: {key}: must be text, not {data[key]!r:.80}")
    if data["schema"] != SCHEMA_VERSION or data["type"] != type_id:
        raise InputError(
            f"{path}: schema {data['schema']!r} or type {data['type']!r} is not what was asked for"
        )
    for key, value in data["maps"].items():
        if not isinstance(value, int) or value < TEST_PER_TRAIN or value % TEST_PER_TRAIN:
            raise InputError(
                f"{path}: maps: {key}: {value!r:.80} is no multiple of {TEST_PER_TRAIN} (test has one map for so many)"
            )
    _check(path, "horizon", data["horizon"], _TICKS)
    for key, value in data["numbers"].items():
        kind = next(
            (_RANGES[end] for end in sorted(_RANGES, key=len, reverse=True) if key.endswith(end)), _COUNT
        )
        _check(path, f"numbers: {key}", value, kind)
    _check_order(path, data["numbers"])
    for key, value in data["choices"].items():
        if not isinstance(value, list) or not value:
            raise InputError(f"{path}: choices: {key}: must be a list of at least one")
        for entry in value:
            _check_choice(path, f"choices: {key}", entry, _CHOICES.get(key, str))
    return Recipe(
        type=catalog.type(type_id),
        placement=str(data["placement"]),
        horizon=int(data["horizon"]),
        maps={str(k): int(v) for k, v in data["maps"].items()},
        numbers={str(k): float(v) for k, v in data["numbers"].items()},
        choices={str(k): list(v) for k, v in data["choices"].items()},
        blind_baseline=str(data.get("blind_baseline", "idm")),
        violating_baseline=str(data.get("violating_baseline", "")),
        paired=data.get("paired", False),
    )


def _check(path: Path, where: str, value: object, kind: tuple[float, float, str]) -> None:
    """Is it a number within its range? A range of whole numbers wants a whole number."""
    least, most, unit = kind
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise InputError(f"{path}: {where}: {value!r:.80} is not a number")
    whole = isinstance(least, int)
    if not least <= value <= most or (whole and not isinstance(value, int)):
        raise InputError(f"{path}: {where}: {value!r:.80} is not in {least:g} to {most:g} {unit}")


def _check_order(path: Path, numbers: Mapping[str, float]) -> None:
    for low, high in _ORDERED:
        for name, value in numbers.items():
            other = name.replace(low, high)
            if low in name and value > numbers.get(other, value):
                raise InputError(
                    f"{path}: numbers: {name}: {value:g} is more than {other}, {numbers[other]:g}"
                )


def _check_choice(path: Path, where: str, entry: object, kind: Any) -> None:
    if isinstance(kind, tuple):
        _check(path, where, entry, kind)
    elif not isinstance(entry, kind):
        raise InputError(f"{path}: {where}: {entry!r:.80} is no {kind.__name__}")
    elif isinstance(entry, dict):
        for part, value in entry.items():
            if part not in _PARTS:
                raise InputError(f"{path}: {where}: {part!r:.80}: unknown key")
            _check_choice(path, f"{where}: {part}", value, _PARTS[part])


def recipe_types() -> tuple[str, ...]:
    """Types that have a recipe, sorted."""
    return tuple(sorted(p.stem for p in recipes_folder().glob("*.yaml")))
