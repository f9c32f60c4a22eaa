"""Placement by the name that a recipe gives."""

from __future__ import annotations

from tsbench.errors import InputError
from tsbench.scenarios.families.base import Placement
from tsbench.scenarios.families.corridor import DetourPlacement, SpeedZonePlacement
from tsbench.scenarios.families.dual_path import ManoeuvrePlacement
from tsbench.scenarios.families.junction import GiveWayPlacement
from tsbench.scenarios.recipe import Recipe


def placement_of(recipe: Recipe) -> Placement:
    """The placement of a recipe. Raises InputError for a name that is none."""
    if recipe.placement == "give_way":
        return GiveWayPlacement()
    if recipe.placement == "speed_zone":
        return SpeedZonePlacement()
    if recipe.placement == "detour":
        return DetourPlacement()
    if recipe.placement == "manoeuvre":
        return ManoeuvrePlacement(recipe.type.codes[0])
    raise InputError(f"scenarios/recipes/{recipe.type.id}.yaml: placement: unknown {recipe.placement!r}")
