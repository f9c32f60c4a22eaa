"""Minimum speed (4.6) ahead of a driver that is too slow for it. Source: docs/scenes.md, "Minimum speed"."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from lxml import etree

from tsbench.dataset.maps.plain import PlainNet
from tsbench.dataset.placements.placement import (
    Arrangement,
    ScenePlacement,
    SceneTask,
    passenger_lanes,
    plate_beside,
    require,
)
from tsbench.dataset.placements.speed_zone import KMH, no_slower
from tsbench.dataset.scenes.drivers import BODIES
from tsbench.dataset.scenes.elements import moving_car
from tsbench.dataset.scenes.recipe import Recipe
from tsbench.dataset.scenes.variants import INITIAL_SPEEDS_MPS
from tsbench.roads.destination import Destination
from tsbench.roads.network import Lane
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.plate_params import ZoneParams
from tsbench.sim.scene import EgoStart
from tsbench.sim.world import EGO_LENGTH_M


def task_minimum(task: SceneTask) -> float:
    """The number on a variant's plate, km/h: round those that the road allows, so that each is there as often."""
    recipe, shown = task.recipe, task.network.expected_speed(task.row.fields["edge"])
    road = min(task.row.speed_mps, shown) / KMH
    usable = [v for v in recipe.choices["limits_kmh"] if v + recipe.number("below_road_kmh") <= road + 0.5]
    require(bool(usable), f"the road's own limit is {road:.0f} km/h")
    return float(usable[task.variant.value % len(usable)])


class MinSpeedPlacement(ScenePlacement):
    """`min_speed`: 4.6 soon after the start; now and then a leader slower than the minimum, which excuses.

    In the contrast half the plate there allows no more than the speed of the slow style, the blind baseline. The
    leader is faster than this style, and so out of its reach where the rule binds; so is everybody else.
    """

    def __init__(self, recipe: Recipe) -> None:
        self.code = recipe.type.codes[0]

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The road stays as it is: who obeys drives faster of itself."""
        del row, recipe
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
            (INITIAL_SPEEDS_MPS[0], INITIAL_SPEEDS_MPS[-1]),
            (recipe.number("most_deficit_kmh"), recipe.number("least_deficit_kmh")),
        )
        end_s = lane.line.length - recipe.number("end_before_edge_m")
        latest = end_s - recipe.number("zone_m") - recipe.number("plate_after_start_m")
        front = EGO_LENGTH_M + recipe.number("start_after_edge_m")
        require(latest >= front, f"the corridor is {lane.line.length:.0f} m long")
        front += float(task.rng.uniform(0.0, min(latest - front, recipe.number("jitter_m"))))
        plate_s = front + recipe.number("plate_after_start_m")
        # No farther than the slow style gets within the horizon.
        end_s = min(end_s, plate_s + max(recipe.number("zone_m"), variant.route_length))
        start = EgoStart(lane.id, front - EGO_LENGTH_M / 2, (minimum - float(deficit)) * KMH)
        leader = self._leader(task, lane, front, minimum)
        sign = plate_beside(network, self.code, edge, plate_s, ZoneParams((edge,)), value=minimum)
        return Arrangement(
            signs=(sign,), target=sign.id,
            start=start, destination=Destination(edge, end_s), route_hint=(edge,), route_length=end_s - plate_s,
            extra=leader, drivers=no_slower(task.drivers, minimum + recipe.number("others_above_kmh")),
            blocked=((lane.id, start.s, front + recipe.number("leader_clear_m")),) if leader else (),
        )  # fmt: skip

    def contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement:
        """3.24 on the same post: the minimum less 10 km/h and more is the most that is allowed."""
        (sign,) = signed.signs
        recipe = task.recipe
        value = sign.posted - recipe.number("contrast_below_kmh")
        other = replace(sign, code=recipe.choices["contrast_plates"][0], value=value)
        return replace(signed, signs=(other,))

    @staticmethod
    def _leader(task: SceneTask, lane: Lane, front: float, minimum: float) -> tuple[etree._Element, ...]:
        """The slower leader's type and vehicle; () in most scenes."""
        recipe = task.recipe
        if float(task.rng.uniform()) >= recipe.number("leader_share"):
            return ()
        length, width = BODIES["m"]
        speed = (minimum - recipe.number("leader_below_kmh")) * KMH
        driver = replace(task.drivers[0], speed=speed, length=length, width=width)
        place = front + recipe.number("leader_gap_m") + length
        return moving_car(
            "leader_0", driver, lane.order, place * lane.length / lane.line.length, (lane.edge,)
        )
