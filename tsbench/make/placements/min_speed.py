"""Minimum speed (4.6) ahead of a driver that is too slow for it. Source: docs/scenes.md, "Minimum speed"."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tsbench.make.maps.plain import PlainNet
from tsbench.make.placements.placement import (
    Arrangement,
    ScenePlacement,
    SceneTask,
    passenger_lanes,
    plate_beside,
    require,
)
from tsbench.make.placements.speed_zone import KMH, can_post
from tsbench.make.scenes.recipe import Recipe
from tsbench.make.scenes.variants import INITIAL_SPEEDS_MPS
from tsbench.roads.lane_graph import Destination
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.plate_params import ZoneParams
from tsbench.sim.scene import EgoStart
from tsbench.sim.world import EGO_LENGTH_M


def task_minimum(task: SceneTask) -> float:
    """The number on a variant's plate, km/h: round those that the road allows, so that each is there as often."""
    recipe, shown = task.recipe, task.network.expected_speed(task.row.fields["edge"])
    road = min(task.row.speed_mps, shown) / KMH
    (code,), other = recipe.type.codes, recipe.choices["contrast_plates"][0]
    below = recipe.number("contrast_below_kmh")
    usable = [
        v
        for v in recipe.choices["limits_kmh"]
        if v + recipe.number("below_road_kmh") <= road + 0.5
        and can_post(recipe, task.row, code, v)
        and can_post(recipe, task.row, other, v - below)
    ]
    require(bool(usable), f"no minimum for a {task.row.road_class} road of {road:.0f} km/h")
    return float(usable[task.variant.value % len(usable)])


class MinSpeedPlacement(ScenePlacement):
    """`min_speed`: 4.6 soon after the start.

    In the contrast half the plate there allows no more than the speed of the slow style, the blind baseline. No other
    vehicle drives on the road: none could keep both halves' plates.
    """

    def __init__(self, recipe: Recipe) -> None:
        self.code = recipe.type.codes[0]

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The road stays as it is."""
        del recipe
        require(not row.oneway, "no other direction, where the other half's plate faces")
        return plain

    def place(self, task: SceneTask) -> Arrangement:
        """The ego 30 m before the plate, 12 to 18 km/h too slow."""
        row, network, recipe, variant = task.row, task.network, task.recipe, task.variant
        minimum = task_minimum(task)
        edge = row.fields["edge"]
        lanes = passenger_lanes(network, edge)
        require(len(lanes) >= recipe.number("least_lanes"), f"{len(lanes)} lanes for cars")
        lane = lanes[variant.layout % len(lanes)]
        # The slower a variant starts, the farther it is below the minimum.
        deficit = np.interp(
            variant.initial_speed,
            INITIAL_SPEEDS_MPS,
            (recipe.number("most_deficit_kmh"), recipe.number("least_deficit_kmh")),
        )
        end_s = lane.line.length - recipe.number("end_before_edge_m")
        latest = end_s - recipe.number("zone_m") - recipe.number("plate_after_start_m")
        front = EGO_LENGTH_M + recipe.number("start_after_edge_m")
        require(latest >= front, f"the corridor is {lane.line.length:.0f} m long")
        front += float(task.rng.uniform(0.0, min(latest - front, recipe.number("jitter_m"))))
        plate_s = front + recipe.number("plate_after_start_m")
        # No farther than the slow style gets within the horizon.
        end_s = plate_s + variant.route_end(recipe.number("zone_m"), end_s - plate_s)
        start = EgoStart(lane.id, front - EGO_LENGTH_M / 2, (minimum - float(deficit)) * KMH)
        sign = plate_beside(network, self.code, edge, plate_s, ZoneParams((edge,)), value=minimum)
        return Arrangement(
            signs=(sign,),
            target=sign.id,
            start=start,
            destination=Destination(edge, end_s),
            route_hint=(edge,),
            route_length=end_s - plate_s,
            closed_edges=frozenset(network.edges),
        )

    def contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement:
        """3.24 on the same post: the minimum less 10 km/h and more is the most that is allowed."""
        (sign,) = signed.signs
        recipe = task.recipe
        value = sign.posted - recipe.number("contrast_below_kmh")
        other = replace(sign, code=recipe.choices["contrast_plates"][0], value=value)
        return replace(signed, signs=(other,))
