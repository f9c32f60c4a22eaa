"""Placement by the name that a recipe gives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from tsbench.core.errors import InputError
from tsbench.make.placements.blocked_ways import ClosedRoadPlacement, DetourPlacement
from tsbench.make.placements.crosswalk import CrosswalkPlacement
from tsbench.make.placements.dual_path import ManoeuvrePlacement, NoEntryPlacement, OneWayPlacement
from tsbench.make.placements.junction import GiveWayPlacement
from tsbench.make.placements.placement import ScenePlacement
from tsbench.make.placements.reserved_lane_scenes import ContraflowPlacement, ReservedLanePlacement
from tsbench.make.placements.roundabout import RoundaboutPlacement
from tsbench.make.placements.speed_zone import MinSpeedPlacement, SpeedZonePlacement, ZonePlacement
from tsbench.make.placements.two_signs import (
    LimitAheadPlacement,
    StopAheadPlacement,
    TemporaryLimitPlacement,
    YieldAheadPlacement,
)
from tsbench.make.scenes.recipe import Recipe

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
    if recipe.last is not None:
        assert recipe.first is not None
        if recipe.first.placement == "give_way":
            stops = recipe.catalog.sign(recipe.first.type.codes[0]).rule.name == "stop"
            return (StopAheadPlacement if stops else YieldAheadPlacement)(recipe)
        if recipe.first.type == recipe.last.type:
            return TemporaryLimitPlacement(recipe)
        return LimitAheadPlacement(recipe, placement_of(recipe.last))
    make = PLACEMENTS.get(recipe.placement)
    if make is None:
        raise InputError(f"scenarios/recipes/{recipe.type.id}.yaml: placement: unknown {recipe.placement!r}")
    return make(recipe)
