"""Contact of the ego with road users and obstacles, from footprints. Units: m, rad."""

from __future__ import annotations

import math

import numpy as np

from tsbench.geometry.footprint import boxes_overlap
from tsbench.sim.scene import Obstacle
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M, Actors, EgoState

_EGO_RADIUS_M = math.hypot(EGO_LENGTH_M, EGO_WIDTH_M) / 2


def touched_actor(ego: EgoState, actors: Actors) -> int:
    """Position in `actors` of the first one whose footprint overlaps the ego's; -1 if there is none."""
    if not len(actors):
        return -1
    pose = actors.pose
    dx, dy = pose[:, 0] - ego.x, pose[:, 1] - ego.y
    # Half the longest body plus a metre and a half is beyond any corner of a road vehicle.
    reach = actors.table.longest * 0.5 + 1.5 + _EGO_RADIUS_M
    near = np.flatnonzero(dx * dx + dy * dy < reach * reach)
    if not near.size:
        return -1
    length, width = actors.length, actors.width
    for k in near.tolist():
        x, y, heading = pose[k].tolist()
        if boxes_overlap(
            ego.x,
            ego.y,
            ego.heading,
            EGO_LENGTH_M,
            EGO_WIDTH_M,
            x,
            y,
            heading,
            float(length[k]),
            float(width[k]),
        ):
            return int(k)
    return -1


def touched_obstacle(ego: EgoState, obstacles: tuple[Obstacle, ...]) -> Obstacle | None:
    """The first obstacle that the ego's footprint overlaps."""
    for o in obstacles:
        if boxes_overlap(
            ego.x, ego.y, ego.heading, EGO_LENGTH_M, EGO_WIDTH_M, o.x, o.y, o.heading, o.length, o.width
        ):
            return o
    return None
