"""Placement by the name that a recipe gives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from tsbench.errors import InputError
from tsbench.scenarios.families.base import Placement
from tsbench.scenarios.families.closed_road import ClosedRoadPlacement
from tsbench.scenarios.families.contraflow import ContraflowPlacement
from tsbench.scenarios.families.crosswalk import CrosswalkPlacement
from tsbench.scenarios.families.detour import DetourPlacement
from tsbench.scenarios.families.dual_path import ManoeuvrePlacement, NoEntryPlacement, OneWayPlacement
from tsbench.scenarios.families.junction import GiveWayPlacement
from tsbench.scenarios.families.min_speed import MinSpeedPlacement
from tsbench.scenarios.families.reserved_lane import ReservedLanePlacement
from tsbench.scenarios.families.roundabout import RoundaboutPlacement
from tsbench.scenarios.families.speed_zone import SpeedZonePlacement
from tsbench.scenarios.recipe import Recipe

PLACEMENTS: Mapping[str, Callable[[Recipe], Placement]] = MappingProxyType(
    {
        "give_way": GiveWayPlacement,
        "roundabout": RoundaboutPlacement,
        "crosswalk": CrosswalkPlacement,
        "speed_zone": SpeedZonePlacement,
        "min_speed": MinSpeedPlacement,
        "detour": DetourPlacement,
        "closed_road": ClosedRoadPlacement,
        "manoeuvre": ManoeuvrePlacement,
        "one_way_exit": OneWayPlacement,
        "no_entry": NoEntryPlacement,
        "reserved_lane": ReservedLanePlacement,
        "contraflow": ContraflowPlacement,
    }
)


def placement_of(recipe: Recipe) -> Placement:
    """The placement of a recipe. Raises InputError for a name that is none."""
    make = PLACEMENTS.get(recipe.placement)
    if make is None:
        raise InputError(f"scenarios/recipes/{recipe.type.id}.yaml: placement: unknown {recipe.placement!r}")
    return make(recipe)
