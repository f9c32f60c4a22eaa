"""Detour scenes: an obstacle on the ego's lane, to be passed on a side that its plate allows.

Source: docs/scenes.md, "Detours". Units: m.
"""

from __future__ import annotations

from dataclasses import replace

from tsbench.dataset.maps.plain import PlainNet
from tsbench.dataset.placements.placement import (
    Arrangement,
    ScenePlacement,
    SceneTask,
    passenger_lanes,
    require,
    start_speed,
)
from tsbench.dataset.scenes.drivers import BODIES
from tsbench.dataset.scenes.recipe import Recipe
from tsbench.roads.destination import Destination
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.annotations import SignInstance
from tsbench.signs.plate_params import ObstacleParams
from tsbench.sim.scene import EgoStart, Obstacle
from tsbench.sim.world import EGO_LENGTH_M

# The front of a car that stands behind an obstacle is at least so far past its end.
_LONGEST_CAR_M = max(length for length, _ in BODIES.values())


class DetourPlacement(ScenePlacement):
    """`detour_*`: an obstacle on a lane with one on each side; in the contrast half it is passed on the other."""

    def __init__(self, recipe: Recipe) -> None:
        self.code = recipe.type.codes[0]

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The road stays as it is: other traffic sees the obstacle itself."""
        require(row.lanes >= recipe.number("least_lanes"), f"{row.lanes} lanes")
        return plain

    def place(self, task: SceneTask) -> Arrangement:
        """The ego 60 m before the obstacle, in its lane."""
        row, network, recipe, variant = task.row, task.network, task.recipe, task.variant
        edge = row.fields["edge"]
        lanes = passenger_lanes(network, edge)
        require(len(lanes) >= recipe.number("least_lanes"), f"{len(lanes)} lanes for cars")
        between = lanes[1:-1]
        lane = between[variant.layout // 2 % len(between)]
        shapes = recipe.choices["obstacles"]
        shape = shapes[variant.layout % len(shapes)]
        length, width = float(shape["length_m"]), float(shape["width_m"])
        ahead = recipe.number("ego_before_obstacle_m")
        length_m = lane.line.length
        latest = length_m - recipe.number("least_after_m") - length
        front = EGO_LENGTH_M + recipe.number("start_room_m")
        front += float(task.rng.uniform(0.0, recipe.number("jitter_m")))
        near = min(front + ahead + 0.5 * EGO_LENGTH_M, latest)
        start_s = near - ahead - EGO_LENGTH_M / 2
        require(start_s >= EGO_LENGTH_M / 2, f"the corridor is {length_m:.0f} m long")
        middle = near + length / 2
        x, y = lane.line.point_at(middle)
        heading = lane.line.heading_at(middle)
        obstacle = Obstacle("obstacle_0", str(shape["shape"]), x, y, heading, length, width, lane.id)
        px, py = lane.line.point_at(near)
        sign = SignInstance(
            id="sign_0", code=self.code, value=None, edge=edge, lane=lane.order, position_m=near, x=px, y=py,
            heading=lane.line.heading_at(near), role="target", params=ObstacleParams(obstacle.id),
        )  # fmt: skip
        end_s = min(middle + variant.route_length, length_m - recipe.number("end_before_edge_m"))
        beyond = near + length + _LONGEST_CAR_M + 1.0
        return Arrangement(
            signs=(sign,), target=sign.id,
            start=EgoStart(lane.id, start_s, start_speed(task, lane)),
            destination=Destination(edge, end_s), route_hint=(edge,), route_length=end_s - middle,
            obstacles=(obstacle,), blocked=((lane.id, start_s, beyond),),
        )  # fmt: skip

    def contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement | None:
        """The plate of the other side; where both are allowed, none contradicts it."""
        others = task.recipe.choices.get("contrast_plates")
        if others is None:
            return None
        return replace(signed, signs=(replace(signed.signs[0], code=others[0]),))
