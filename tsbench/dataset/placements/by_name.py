"""Placement by the name that a recipe gives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from tsbench.core.errors import InputError
from tsbench.dataset.placements.closed_road import ClosedRoadPlacement
from tsbench.dataset.placements.contraflow import ContraflowPlacement
from tsbench.dataset.placements.crosswalk import CrosswalkPlacement
from tsbench.dataset.placements.detour import DetourPlacement
from tsbench.dataset.placements.dual_path import ManoeuvrePlacement, NoEntryPlacement, OneWayPlacement
from tsbench.dataset.placements.junction import GiveWayPlacement
from tsbench.dataset.placements.min_speed import MinSpeedPlacement
from tsbench.dataset.placements.placement import ScenePlacement
from tsbench.dataset.placements.reserved_lane import ReservedLanePlacement
from tsbench.dataset.placements.roundabout import RoundaboutPlacement
from tsbench.dataset.placements.speed_zone import SpeedZonePlacement, ZonePlacement
from tsbench.dataset.scenes.recipe import Recipe

PLACEMENTS: Mapping[str, Callable[[Recipe], ScenePlacement]] = MappingProxyType(
    {
        "give_way": GiveWayPlacement,
        "roundabout": RoundaboutPlacement,
        "crosswalk": CrosswalkPlacement,
        "speed_zone": SpeedZonePlacement,
        "zone": ZonePlacement,
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


def placement_of(recipe: Recipe) -> ScenePlacement:
    """The placement of a recipe. Raises InputError for an unknown name."""
    make = PLACEMENTS.get(recipe.placement)
    if make is None:
        raise InputError(f"scenarios/recipes/{recipe.type.id}.yaml: placement: unknown {recipe.placement!r}")
    return make(recipe)
