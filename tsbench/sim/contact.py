"""Contact of the ego with road users and obstacles, from footprints. Units: m, rad."""

from __future__ import annotations

import math

from tsbench.geometry.footprint import boxes_overlap
from tsbench.sim.scene import Obstacle
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M, Actors, EgoState

_EGO_RADIUS_M = math.hypot(EGO_LENGTH_M, EGO_WIDTH_M) / 2


def touched_actor(ego: EgoState, actors: Actors) -> int:
    """Position in `actors` of the first one whose footprint overlaps the ego's, or -1."""
    ex, ey = ego.x, ego.y
    # Half the longest body plus a metre and a half is beyond any corner of a road vehicle.
    reach = actors.table.longest * 0.5 + 1.5 + _EGO_RADIUS_M
    for k, box in enumerate(actors.boxes):
        dx, dy = box[0] - ex, box[1] - ey
        if dx * dx + dy * dy < reach * reach and boxes_overlap(
            ex, ey, ego.heading, EGO_LENGTH_M, EGO_WIDTH_M, *box
        ):
            return k
    return -1


def touched_obstacle(ego: EgoState, obstacles: tuple[Obstacle, ...]) -> Obstacle | None:
    """The first obstacle that the ego's footprint overlaps."""
    for o in obstacles:
        if boxes_overlap(
            ego.x, ego.y, ego.heading, EGO_LENGTH_M, EGO_WIDTH_M, o.x, o.y, o.heading, o.length, o.width
        ):
            return o
    return None
