"""How many maps of each type are from extracts with full tags, and how many such maps there were to take."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from tsbench.make.city import chosen_city
from tsbench.make.scenes.recipe import load_recipes, stratum_of
from tsbench.make.scenes.split import split_pool
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.map_pool import read_pool
from tsbench.scenarios.spec import ScenarioSpec

# Of a routing type's test maps at most this share is to be from the generalised extract (docs/scenes.md).
GOAL = 0.3
ROUTING = "routing"


@dataclass(frozen=True)
class Tagging:
    """Maps of a type in one split. plain: from the generalised extract. there: tagged maps of the pool in that split.

    `there` counts what the recipe's strata admit. A build tries these before any plain map of the same stratum.
    """

    type_id: str
    split: str
    routing: bool
    maps: int
    plain: int
    there: int

    @property
    def share(self) -> float:
        return self.plain / self.maps

    @property
    def tagged(self) -> int:
        return self.maps - self.plain


def tagging(specs: Sequence[ScenarioSpec]) -> list[Tagging]:
    """One entry per type and split, in alphabetical order. Raises InputError."""
    data = DataSet.in_use()
    pool = read_pool(data.pool_path)
    known, split_of = {row.map_id: row for row in pool}, split_pool(pool, chosen_city().split)
    used: dict[tuple[str, str], set[str]] = defaultdict(set)
    for spec in specs:
        used[(spec.pair_type, spec.split)].add(spec.map_id)
    found = []
    recipes = {recipe.type.id: recipe for recipe in load_recipes(data.catalog, {type_id for type_id, _ in used})}
    for (type_id, split), maps in sorted(used.items()):
        recipe = recipes[type_id]
        there = sum(
            row.well_tagged
            and row.family == recipe.type.family
            and split_of[row.map_id] == split
            and stratum_of(row) in recipe.maps
            for row in pool
        )
        plain = sum(not known[one].well_tagged for one in maps)
        found.append(Tagging(type_id, split, recipe.type.group == ROUTING, len(maps), plain, there))
    return found
