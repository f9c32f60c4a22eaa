"""Recipes: one YAML per scenario type under `scenarios/recipes/`; the numbers of a scene, none of them in code.

By them each map has ten variants (docs/scenes.md, "Variants").
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, TypedDict

import numpy as np
from msgspec import Meta

from tsbench.core.benchmark import TEST_PER_TRAIN, VARIANTS
from tsbench.core.errors import InputError
from tsbench.core.paths import data_file
from tsbench.core.typed import read_sheet, typed
from tsbench.make.seeds import rng_of, seed_of
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.catalog import Catalog, ScenarioType
from tsbench.sim.nuplan import DENSITY_KEY, LANE_KM_WITHIN_REACH, SPEED_KEY, quantile

_Few = Annotated[int, Meta(ge=1, le=20)]
_Kmh = Annotated[float, Meta(ge=1, le=200)]
_Seconds = Annotated[float, Meta(ge=0, le=600)]
_Share = Annotated[float, Meta(ge=0, le=1)]
# What a number may be, by the end of its name: metres, m/s and so on. What has none of these ends is a count.
_BY_END: dict[str, Any] = {
    "_m": Annotated[float, Meta(ge=0, le=1000)],
    "_mps": Annotated[float, Meta(ge=0.1, le=60)],
    "_kmh": _Kmh,
    "_mps2": Annotated[float, Meta(ge=0.1, le=10)],
    "_s": _Seconds,
    "_deg": Annotated[float, Meta(ge=0, le=180)],
    "_share": _Share,
    "_ratio": Annotated[float, Meta(ge=0, le=10)],
    "": Annotated[int, Meta(ge=0, le=100)],
}
# Names that have to stand in order where a recipe has both.
_ORDERED = (("least", "most"), ("nearest", "farthest"))
ROUTE_LENGTHS_M = (60.0, 120.0)
# Of the published density: from the first of its quantiles to the last.
DENSITY_SHARES = (0.05, 0.95)
LEAST_SPEED_MPS = 1.0
# The published quartiles: where a type has another scale of speeds, they are its ends.
INITIAL_SPEEDS_MPS = (3.61, 11.05)
DRIVER_DRAWS = 3
LAYOUTS = 6
DISTRACTORS = (2, 3, 1, 0)  # of ten variants three have the first number, three the second
NOMINAL_SPEED_MPS = 7.75


class _Preset(TypedDict, total=False):
    count: _Few
    gap_s: _Seconds
    gap_share: _Share
    alternate: bool


class _Obstacle(TypedDict, total=False):
    shape: str
    length_m: Annotated[float, Meta(ge=0.1, le=100)]
    width_m: Annotated[float, Meta(ge=0.1, le=20)]


# What lists of choices are of, where it is not text.
_CHOICES: dict[str, Any] = {
    "users": list[_Few],
    "limits_kmh": list[_Kmh],
    "contrast_kmh": list[_Kmh],
    "presets": list[_Preset],
    "tracks_m": list[Annotated[float, Meta(ge=-10, le=10)]],
    "obstacles": list[_Obstacle],
}


@dataclass(frozen=True, kw_only=True)
class _Arrangement:
    placement: str
    horizon: Annotated[int, Meta(ge=10, le=10_000)]
    maps: dict[str, Annotated[int, Meta(ge=TEST_PER_TRAIN, multiple_of=TEST_PER_TRAIN)]]
    numbers: dict[str, int | float]
    choices: dict[str, Annotated[list[Any], Meta(min_length=1)]]
    blind_baseline: str = "idm"
    violating_baseline: str = ""
    paired: bool = False


@dataclass(frozen=True, kw_only=True)
class _File(_Arrangement):
    type: str


@dataclass(frozen=True, kw_only=True)
class _CombinedFile:
    type: str
    maps: dict[str, Annotated[int, Meta(ge=TEST_PER_TRAIN, multiple_of=TEST_PER_TRAIN)]]
    numbers: dict[str, int | float]


@dataclass(frozen=True, kw_only=True)
class Recipe(_Arrangement):
    """How scenes of one type are arranged.

    placement: name of the placement (scenarios.families). maps: number of maps by stratum, keys such as "T" or
    "straight/2", for the train split and a quarter of it for test. numbers: lengths in m, speeds in m/s, times in s,
    as their names say. choices: lists to draw from. blind_baseline: the sign-blind driver that has to break the rule
    (docs/scenes.md, "Certificates"). violating_baseline: a driver that should break it in a draw, "" = none. It
    is asked for where traffic often ends the other's episode first. paired: have its rows a contrast half?
    catalog: the signs and rules that scenes are made by. first, last: of a type with two signs the recipes of its
    parts; the last, with the type's own numbers, decides the rest.
    """

    type: ScenarioType
    catalog: Catalog = field(repr=False, compare=False)
    first: Recipe | None = None
    last: Recipe | None = None

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
    if parts := catalog.type(type_id).parts:
        first, last = (load_recipe(part, catalog, folder) for part in parts)
        return read_sheet(_CombinedFile, path, "type", lambda file: _combined(file, first, last))
    return read_sheet(_File, path, "type", lambda file: _recipe(file, catalog))


def load_recipes(catalog: Catalog, types: Iterable[str]) -> list[Recipe]:
    """The recipes of some types, of all that have one where none is named. Raises InputError (file, key, problem)."""
    return [load_recipe(type_id, catalog) for type_id in types or recipe_types()]


def _combined(file: _CombinedFile, first: Recipe, last: Recipe) -> Recipe:
    kind, numbers = first.catalog.type(file.type), last.numbers | _numbers(file.numbers)
    changed = replace(last, numbers=numbers)
    return replace(changed, type=kind, maps=file.maps, first=first, last=changed)


def _numbers(given: Mapping[str, int | float]) -> dict[str, float]:
    return {key: float(_named(f"numbers: {key}", _of_end(key), value)) for key, value in given.items()}


def _recipe(file: _File, catalog: Catalog) -> Recipe:
    numbers = _numbers(file.numbers)
    for low, high in _ORDERED:
        for name, value in numbers.items():
            other = name.replace(low, high)
            if low in name and value > numbers.get(other, value):
                raise ValueError(f"numbers: {name}: {value:g} is more than {other}, {numbers[other]:g}")
    for key, entries in file.choices.items():
        _named(f"choices: {key}", _CHOICES.get(key, list[str]), entries)
    return Recipe(**{**vars(file), "numbers": numbers, "type": catalog.type(file.type), "catalog": catalog})


def _of_end(name: str) -> Any:
    return _BY_END[max((end for end in _BY_END if name.endswith(end)), key=len)]


def _named(where: str, kind: Any, value: object) -> Any:
    try:
        return typed(kind, value)
    except ValueError as problem:
        raise ValueError(f"{where}: {problem}") from None


def recipe_types() -> tuple[str, ...]:
    """Types that have a recipe, sorted."""
    return tuple(sorted(p.stem for p in recipes_folder().glob("*.yaml")))


def stratum_of(row: PoolRow) -> str:
    """The quota that a map counts for, as recipes name it."""
    if row.family == "corridor":
        return f"{row.shape}/{row.lane_bucket}"
    if row.family == "dual_path":
        return f"{row.slot}/{row.shape}"
    return row.shape


@dataclass(frozen=True, slots=True)
class Variant:
    """What one scene of a map asks. `number` 0 is nominal: no background traffic (density 0, drivers -1).

    route_length: m asked after the decision point, within ROUTE_LENGTHS_M. density: moving cars per lane within 150 m.
    initial_speed: m/s. drivers: number of their draw, below DRIVER_DRAWS. layout: number on the scene's own axis, taken
    modulo the choices that the map gives; so are value (of what the plate posts) and plate (of several that say the
    like). distractors: how many plates stand there that don't bind the ego.
    """

    number: int
    route_length: float
    density: float
    initial_speed: float
    drivers: int
    layout: int
    value: int = 0
    plate: int = 0
    distractors: int = 0

    @property
    def cars_per_lane_km(self) -> float:
        """The density per lane-kilometre: 150 m ahead and behind are 0.3 km of lane."""
        return self.density / LANE_KM_WITHIN_REACH

    def route_end(self, least: float, room: float) -> float:
        """Where the route ends, m after the decision point.

        The ends of a map's variants spread over its room of at most the greatest asked length, from half of it up.
        least: m that the type needs. room: m that the map has, at least as much.
        """
        low, high = ROUTE_LENGTHS_M
        most = min(room, high)
        start = max(least, most / 2)
        return round(start + (most - start) * (self.route_length - low) / (high - low), 1)


def variants_of(scenario_type: str, map_id: str) -> tuple[Variant, ...]:
    """Variant 0 and nine others, drawn by a stable hash of type and map.

    Speed, density and route length are stratified: each of a map's nine variants lies in another ninth of their
    distributions. Drivers, layouts and what the plates post go round their axes from variant to variant, so that each
    number is there about as often.
    """
    rng = rng_of("variants", scenario_type, map_id)
    count = VARIANTS - 1
    speeds, densities, lengths = ((rng.permutation(count) + rng.random(count)) / count for _ in range(3))
    drivers = rng.permutation(np.arange(count) % DRIVER_DRAWS)
    layouts = rng.permutation(np.arange(count) % LAYOUTS)
    nominal = (ROUTE_LENGTHS_M[0], 0.0, NOMINAL_SPEED_MPS, -1, seed_of("layout", map_id) % LAYOUTS)
    drawn = (
        (
            round(float(np.interp(lengths[k], (0.0, 1.0), ROUTE_LENGTHS_M)), 1),
            round(quantile(DENSITY_KEY, float(np.interp(densities[k], (0.0, 1.0), DENSITY_SHARES))), 2),
            round(max(quantile(SPEED_KEY, float(speeds[k])), LEAST_SPEED_MPS), 2),
            int(drivers[k]),
            int(layouts[k]),
        )
        for k in range(count)
    )
    asked = rng_of("asked", scenario_type, map_id)
    first, plates = int(asked.integers(VARIANTS)), asked.permutation(VARIANTS)
    distractors = asked.permutation(np.arange(VARIANTS) % len(DISTRACTORS))
    return tuple(
        Variant(k, *point, value=first + k, plate=int(plates[k]), distractors=DISTRACTORS[int(distractors[k])])
        for k, point in enumerate([nominal, *drawn])
    )
