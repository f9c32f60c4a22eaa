"""Which types a city carries, on how many maps of each split, and why not on more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from tsbench.dataset.city import City
from tsbench.dataset.scenes.build import stratum_of
from tsbench.dataset.scenes.overview import shown_reason
from tsbench.dataset.scenes.recipe import Recipe
from tsbench.dataset.scenes.split import split_pool
from tsbench.scenarios.map_pool import PoolRow


@dataclass(frozen=True)
class Carried:
    """A type in a split. there: maps of its family and strata. maps: built ones, of so many wanted. why: not more."""

    type_id: str
    split: str
    there: int
    maps: int
    wanted: int
    why: str


def carried(
    city: City, pool: Sequence[PoolRow], recipes: Sequence[Recipe], report: Sequence[dict[str, Any]]
) -> list[Carried]:
    """One entry for each type and split of the city. report: what its last build wrote down, () before the first."""
    split_of = split_pool(pool, city.split)
    built = {(entry["type_id"], entry["split"]): entry for entry in report}
    found = []
    for recipe in recipes:
        for split, most in city.maps.items():
            there = sum(
                row.family == recipe.type.family
                and split_of[row.map_id] == split
                and stratum_of(row) in recipe.maps
                for row in pool
            )
            entry = built.get((recipe.type.id, split))
            maps = sum(entry["maps"].values()) if entry else 0
            why = "" if maps >= most else _why(recipe, there, entry)
            found.append(Carried(recipe.type.id, split, there, maps, most, why))
    return found


def _why(recipe: Recipe, there: int, entry: dict[str, Any] | None) -> str:
    if not there:
        return f"no {recipe.type.family.replace('_', ' ')} of {', '.join(recipe.maps)} in its tiles"
    if entry is None:
        return "not built yet"
    reasons = [f"{count} {shown_reason(reason)}" for reason, count in entry["reasons"].items()]
    return "; ".join(reasons) or "the maps lie too near to each other"
