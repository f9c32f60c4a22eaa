"""Whose fault a contact is: nuPlan's "no ego at-fault collisions", brought down to what footprints say.

The ego is at fault where it moved and struck with its front or a side that it swung in; it is not where it
stood, or where the other came from behind. Units: m, rad, m/s.
"""

from __future__ import annotations

import math

from tsbench.geometry.angles import wrap
from tsbench.geometry.polyline import Array
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M, EgoState

STOPPED_MPS = 0.05
_SAME_WAY_RAD = math.radians(60.0)
_SAMPLES = 9


def contact_at_fault(ego: EgoState, pose: Array, speed: float, length: float, width: float) -> bool:
    """Is the ego at fault for touching this road user? Both as of the tick of the contact.

    pose: (3,) x, y, heading of the other's centre. Like nuPlan's: a stopped ego is never at fault, a stopped
    other was hit by the ego, and what touches the ego's rear ran into it, unless the ego goes the same way
    faster.
    """
    if ego.speed <= STOPPED_MPS:
        return False
    if speed <= STOPPED_MPS:
        return True
    along = _contact_along(ego, pose, length, width)
    if along > 0.0:
        return True
    same_way = abs(wrap(float(pose[2]) - ego.heading)) <= _SAME_WAY_RAD
    # Behind its middle the ego is struck, unless it swerves or rolls into one that it overtakes.
    struck_from_behind = along <= -EGO_LENGTH_M / 4
    return not (struck_from_behind and (not same_way or speed >= ego.speed))


def _contact_along(ego: EgoState, pose: Array, length: float, width: float) -> float:
    """Where the footprints meet, m ahead (+) of the ego's centre: mean of outline points in the other."""
    c, s = math.cos(ego.heading), math.sin(ego.heading)
    dx, dy = float(pose[0]) - ego.x, float(pose[1]) - ego.y
    ox, oy = dx * c + dy * s, -dx * s + dy * c
    turn = float(pose[2]) - ego.heading
    tc, ts = math.cos(turn), math.sin(turn)
    half_l, half_w = EGO_LENGTH_M / 2, EGO_WIDTH_M / 2
    found = []
    for u, v in _outline(length / 2, width / 2):
        x, y = ox + u * tc - v * ts, oy + u * ts + v * tc
        if abs(x) <= half_l and abs(y) <= half_w:
            found.append(x)
    for u, v in _outline(half_l, half_w):
        x, y = (u - ox) * tc + (v - oy) * ts, -(u - ox) * ts + (v - oy) * tc
        if abs(x) <= length / 2 and abs(y) <= width / 2:
            found.append(u)
    return sum(found) / len(found) if found else ox


def _outline(half_l: float, half_w: float) -> list[tuple[float, float]]:
    """Points along the outline of a rectangle around the origin."""
    steps = [2.0 * k / (_SAMPLES - 1) - 1.0 for k in range(_SAMPLES)]
    ends = [(sign * half_l, t * half_w) for sign in (1.0, -1.0) for t in steps]
    sides = [(t * half_l, sign * half_w) for sign in (1.0, -1.0) for t in steps]
    return ends + sides
