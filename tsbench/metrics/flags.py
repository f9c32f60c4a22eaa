"""Flags that do not end an episode: stuck, hard braking, overspeed. Source: docs/spec/metrics.md.

Units: m, s, m/s, rad.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tsbench.metrics.comfort import LONGITUDINAL_MPS2
from tsbench.metrics.tracks import Tracks
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S, EGO_LENGTH_M

STUCK_MPS = 0.1
STUCK_S = 20.0
REASON_AHEAD_M = 20.0
REASON_ASIDE_M = 2.0

_Mask = npt.NDArray[np.bool_]


def hard_braking(tracks: Tracks) -> bool:
    return bool((tracks.acceleration < LONGITUDINAL_MPS2[0]).any())


def max_overspeed(tracks: Tracks, scene: Scene) -> float | None:
    """Greatest speed above the limit of the ordinary lane that the ego was on, at least 0; None if on none.

    The limit is the one that planners are shown; what a plate posts is its rule's business.
    """
    network = scene.network
    shown = zip(network.lanes, network.shown_limits, strict=True)
    limit = np.array([np.nan if lane.internal else speed for lane, speed in shown] + [np.nan])
    over = tracks.speed - limit[tracks.lane]
    return None if np.isnan(over).all() else max(float(np.nanmax(over)), 0.0)


def stuck(tracks: Tracks, scene: Scene) -> bool:
    """Did the ego stand for more than 20 s without a reason ahead?

    A reason is another road user or an obstacle with its centre within 20 m ahead of the ego's front:
    straight ahead (2 m to either side) or within 45 degrees of its heading. One that comes by starts the
    count anew.
    """
    still = tracks.speed < STUCK_MPS
    if _longest(still) * DT_S <= STUCK_S:
        return False
    forward, left = tracks.in_ego_frame()
    reason = np.zeros(len(tracks), dtype=bool)
    reason[tracks.tick[_ahead(forward, left)]] = True
    c, s = np.cos(tracks.heading), np.sin(tracks.heading)
    for o in scene.obstacles:
        dx, dy = o.x - tracks.x, o.y - tracks.y
        reason |= _ahead(dx * c + dy * s, dy * c - dx * s)
    return _longest(still & ~reason) * DT_S > STUCK_S


def _ahead(forward: npt.NDArray[np.float64], left: npt.NDArray[np.float64]) -> _Mask:
    gap = forward - EGO_LENGTH_M / 2
    aside = np.abs(left)
    near: _Mask = (gap > 0.0) & (gap <= REASON_AHEAD_M) & ((aside <= gap) | (aside <= REASON_ASIDE_M))
    return near


def _longest(mask: _Mask) -> int:
    edges = np.diff(np.concatenate(([False], mask, [False])).astype(np.int8))
    runs = np.nonzero(edges < 0)[0] - np.nonzero(edges > 0)[0]
    return int(runs.max()) if len(runs) else 0
