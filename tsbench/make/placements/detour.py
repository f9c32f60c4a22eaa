"""Detour scenes: an obstacle on the ego's lane, to be passed on a side that its plate allows.

Source: docs/scenes.md, "Detours". Units: m.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from tsbench.make.maps.plain import PlainNet
from tsbench.make.placements.placement import (
    Arrangement,
    ScenePlacement,
    SceneTask,
    passenger_lanes,
    require,
    start_speed,
)
from tsbench.make.scenes.drivers import BODIES
from tsbench.make.scenes.recipe import Recipe
from tsbench.roads.lane_graph import Destination
from tsbench.roads.network import Lane
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.annotations import DISTRACTOR, SignInstance
from tsbench.signs.plate_params import ObstacleParams
from tsbench.sim.scene import EgoStart, Obstacle
from tsbench.sim.world import EGO_LENGTH_M

# The front of a car that stands behind an obstacle is at least so far past its end.
_LONGEST_CAR_M = max(length for length, _ in BODIES.values())


class DetourPlacement(ScenePlacement):
    """`detour_*`: an obstacle on a lane with one on each side; in the contrast half it is passed on the other.

    Where there is a contrast half, a second obstacle on the same lane lies behind the ego and has the other plate; the
    halves exchange the two. No other vehicle drives in this direction, because none could keep all four plates.
    """

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
        length = float(shape["length_m"])
        ahead = recipe.number("ego_before_obstacle_m")
        length_m = lane.line.length
        latest = length_m - recipe.number("least_after_m") - length
        front = EGO_LENGTH_M + recipe.number("start_room_m")
        front += float(task.rng.uniform(0.0, recipe.number("jitter_m")))
        near = min(front + ahead + 0.5 * EGO_LENGTH_M, latest)
        start_s = near - ahead - EGO_LENGTH_M / 2
        require(start_s >= EGO_LENGTH_M / 2, f"the corridor is {length_m:.0f} m long")
        middle = near + length / 2
        signs = [_plate(0, self.code, lane, near, "target", ObstacleParams("obstacle_0"))]
        obstacles = [_obstacle(0, shape, lane, near)]
        if self._others(recipe):
            passed = recipe.number("passed_after_edge_m")
            room = start_s - EGO_LENGTH_M / 2 - passed - length
            require(room >= recipe.number("passed_before_ego_m"), f"{room:.0f} m behind the obstacle passed")
            signs.append(_plate(1, self._others(recipe)[0], lane, passed, DISTRACTOR))
            obstacles.append(_obstacle(1, shape, lane, passed))
        past = recipe.number("end_before_edge_m")
        end_s = middle + variant.route_end(recipe.number("least_after_m") - past, length_m - past - middle)
        beyond = near + length + _LONGEST_CAR_M + 1.0
        return Arrangement(
            signs=tuple(signs),
            target=signs[0].id,
            start=EgoStart(lane.id, start_s, start_speed(task, lane)),
            destination=Destination(edge, end_s),
            route_hint=(edge,),
            route_length=end_s - middle,
            obstacles=tuple(obstacles),
            blocked=((lane.id, start_s, beyond),),
            closed_edges=frozenset((edge,) if len(obstacles) > 1 else ()),
        )

    def contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement | None:
        """The two plates exchanged; where the target allows both sides, no plate contradicts it."""
        if not self._others(task.recipe):
            return None
        first, second = signed.signs
        return replace(signed, signs=(replace(first, code=second.code), replace(second, code=first.code)))

    @staticmethod
    def _others(recipe: Recipe) -> list[str]:
        """Plates of the contrast half."""
        return recipe.choices.get("contrast_plates", [])


def _obstacle(number: int, shape: dict[str, Any], lane: Lane, near: float) -> Obstacle:
    """An obstacle of the recipe's shape on a lane, its near end at `near`."""
    length, width = float(shape["length_m"]), float(shape["width_m"])
    x, y = lane.line.point_at(near + length / 2)
    heading = lane.line.heading_at(near + length / 2)
    return Obstacle(f"obstacle_{number}", str(shape["shape"]), x, y, heading, length, width, lane.id)


def _plate(
    number: int, code: str, lane: Lane, s: float, role: str, params: ObstacleParams | None = None
) -> SignInstance:
    """The plate on an obstacle's near end."""
    x, y = lane.line.point_at(s)
    return SignInstance(
        id=f"sign_{number}", code=code, value=None, edge=lane.edge, lane=lane.order, position_m=s, x=x, y=y,
        heading=lane.line.heading_at(s), role=role, params=params,
    )  # fmt: skip
