"""What an episode shows about its scene: who was there, whether bodies overlap, whether the agents came in time.

Units: m, s, rad.
"""

from __future__ import annotations

import math

import numpy as np

from tsbench.episode.outcome import EpisodeFacts
from tsbench.geometry.footprint import boxes_overlap
from tsbench.sim.convoy import ConvoyRelease
from tsbench.sim.world import EGO_LENGTH_M, Actors

EVERY_TICKS = 5
# Cars that pass close in a narrow bend brush each other in SUMO by centimetres; this much is a collision.
DEEP_M = 0.5
THIN_M = 0.05


def road_users(facts: EpisodeFacts) -> int:
    """How many other road users came within sight of the ego."""
    return len(facts.snapshots[-1].actors.table.ids)


def overlapping_pairs(facts: EpisodeFacts) -> int:
    """Pairs of other road users whose bodies overlap by more than half a metre at some tick (every half second)."""
    found: set[tuple[int, int]] = set()
    for snapshot in facts.snapshots[::EVERY_TICKS]:
        found.update(_overlaps(snapshot.actors))
    return len(found)


def _overlaps(actors: Actors) -> list[tuple[int, int]]:
    pose, length, width = actors.pose, actors.length, actors.width
    if len(pose) < 2:
        return []
    dx = pose[:, None, 0] - pose[None, :, 0]
    dy = pose[:, None, 1] - pose[None, :, 1]
    reach = 0.5 * np.hypot(length, width)
    near = np.triu(dx * dx + dy * dy < (reach[:, None] + reach[None, :] - DEEP_M) ** 2, 1)
    rows = actors.index
    # Bodies without their outermost quarter of a metre: where these touch, the whole ones overlap deeply.
    cores = [
        (*p, max(float(a) - DEEP_M, THIN_M), max(float(b) - DEEP_M, THIN_M))
        for p, a, b in zip(pose.tolist(), length, width, strict=True)
    ]
    return [
        (int(rows[i]), int(rows[k]))
        for i, k in zip(*np.nonzero(near), strict=True)
        if boxes_overlap(*cores[i], *cores[k])
    ]


def arrival_gap(facts: EpisodeFacts) -> float:
    """Seconds from the ego's arrival at the conflict zone to the lead's, unhindered; NaN without agents.

    The lead's time from its release to the zone is known from when the scene was built. The lead is the first of a
    convoy, or of pedestrians.
    """
    scene = facts.scene
    plan = scene.convoy or scene.walkers
    if plan is None:
        return math.nan
    release = ConvoyRelease(plan, scene.network)
    released = next((s.time for s in facts.snapshots[1:] if release.update(s.ego)), math.nan)
    lane = scene.network.lane(plan.line_lane)
    lanes = frozenset(scene.network.edges[lane.edge].lanes)
    gone: float | None = None
    last = facts.snapshots[0].ego
    for snapshot in facts.snapshots[1:]:
        ego = snapshot.ego
        moved = math.hypot(ego.x - last.x, ego.y - last.y)
        last = ego
        if ego.lane in lanes:
            gone = ego.s + EGO_LENGTH_M / 2 - lane.line.length
        elif gone is not None:
            gone += moved
        if gone is not None and gone >= plan.ego_zone_m:
            return released + plan.lead_time_s - snapshot.time
    return math.nan
