"""How the ego got on with others: efficiency, time to collision, post-encroachment time.

Units: m, s, m/s, rad. All three are values with validity: None says that no other road user was there.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from tsbench.geometry.elementary import arctan2
from tsbench.geometry.polyline import Array
from tsbench.metrics.tracks import Tracks
from tsbench.sim.world import DT_S, EGO_LENGTH_M, EGO_WIDTH_M, ActorKind

EFFICIENCY_RANGE_M = 50.0
EFFICIENCY_MOVING_MPS = 0.5 / 3.6
TTC_HORIZON_S = 10.0
TTC_STOPPED_MPS = 0.1
TTC_BEHIND_RAD = math.radians(150.0)
PET_HORIZON_S = 10.0
PET_CROSSING_RAD = math.radians(30.0)

_CELLS = 1 << 20
_Index = npt.NDArray[np.intp]


def efficiency(tracks: Tracks) -> float | None:
    """Mean over steps of 100 x ego speed / mean speed of moving vehicles within 50 m; None without any.

    Steps without such a vehicle are left out. Vehicles are all but pedestrians; moving: over 0.5 km/h.
    """
    t = tracks.tick
    near = np.hypot(tracks.pose[:, 0] - tracks.x[t], tracks.pose[:, 1] - tracks.y[t]) <= EFFICIENCY_RANGE_M
    use = near & (tracks.a_speed > EFFICIENCY_MOVING_MPS) & (tracks.kind != ActorKind.PEDESTRIAN)
    count = np.bincount(t[use], minlength=len(tracks))
    total = np.bincount(t[use], weights=tracks.a_speed[use], minlength=len(tracks))
    steps = count > 0
    if not steps.any():
        return None
    return float(np.mean(100.0 * tracks.speed[steps] * count[steps] / total[steps]))


def min_ttc(tracks: Tracks) -> float | None:
    """Least time to collision, s; None without a collision course within 10 s.

    At each tick all go on along their headings with their speeds; the time to collision is when the
    footprints would first touch: exact, by the separating axes of two rectangles that do not turn.
    As in nuPlan, a standing ego and road users behind it (bearing beyond 150 degrees) are left out.
    Source: Hayward (1972), in the two-dimensional form that nuPlan uses.
    """
    ahead, left = tracks.in_ego_frame()
    t = tracks.tick
    closing = (EGO_LENGTH_M / 2 + tracks.length) + TTC_HORIZON_S * (tracks.speed[t] + tracks.a_speed)
    use = (tracks.speed[t] > TTC_STOPPED_MPS) & (np.abs(arctan2(left, ahead)) < TTC_BEHIND_RAD)
    k = np.nonzero(use & (ahead * ahead + left * left <= closing * closing))[0]
    if not len(k):
        return None
    turn = tracks.pose[k, 2] - tracks.heading[t[k]]
    c, s = np.cos(turn), np.sin(turn)
    x, y, al, aw = ahead[k], left[k], tracks.length[k] / 2, tracks.width[k] / 2
    vx, vy = tracks.a_speed[k] * c - tracks.speed[t[k]], tracks.a_speed[k] * s
    el, ew = EGO_LENGTH_M / 2, EGO_WIDTH_M / 2
    ac, as_ = np.abs(c), np.abs(s)
    axes = (
        (x, vx, el + al * ac + aw * as_),
        (y, vy, ew + al * as_ + aw * ac),
        (x * c + y * s, vx * c + vy * s, al + el * ac + ew * as_),
        (y * c - x * s, vy * c - vx * s, aw + el * as_ + ew * ac),
    )
    first, last = np.zeros(len(k)), np.full(len(k), TTC_HORIZON_S)
    for place, speed, reach in axes:
        # A relative speed of zero on an axis: together on it for ever, or never.
        safe = np.where(np.abs(speed) < 1e-9, 1e-9, speed)
        a, b = (-reach - place) / safe, (reach - place) / safe
        first, last = np.maximum(first, np.minimum(a, b)), np.minimum(last, np.maximum(a, b))
    meets = first <= last
    return float(first[meets].min()) if meets.any() else None


def min_pet(tracks: Tracks) -> float | None:
    """Least post-encroachment time, s; None without a crossing of the ego's way within 10 s of it.

    The time from one road user leaving a place to the other reaching it: the least |t1 - t2| for which the
    ego's footprint at t1 and the other's at t2 overlap while their headings differ by more than 30 degrees
    (followers on one lane keep a headway, not an encroachment). Resolution: one tick.
    Source: Allen, Shin and Cooper (1978).
    """
    ego = _moving(tracks.x, tracks.y, tracks.heading)
    other = _crossing(tracks, ego)
    if not len(other):
        return None
    reach = math.hypot(EGO_LENGTH_M, EGO_WIDTH_M) / 2 + float(
        np.hypot(tracks.length[other], tracks.width[other]).max() / 2
    )
    pairs = _near_pairs(np.column_stack((tracks.x[ego], tracks.y[ego])), tracks.pose[other, :2], reach)
    i, k = ego[pairs[0]], other[pairs[1]]
    gap = np.abs(i - tracks.tick[k])
    turn = np.abs((tracks.pose[k, 2] - tracks.heading[i] + math.pi) % (2 * math.pi) - math.pi)
    keep = (turn > PET_CROSSING_RAD) & (gap * DT_S <= PET_HORIZON_S)
    i, k, gap = i[keep], k[keep], gap[keep]
    touch = _overlap(tracks, i, k)
    return round(float(gap[touch].min()) * DT_S, 6) if touch.any() else None


def _moving(x: Array, y: Array, heading: Array) -> _Index:
    """Ticks at which the pose is another than before or after: standing still keeps only its two ends."""
    still = (np.diff(x) == 0.0) & (np.diff(y) == 0.0) & (np.diff(heading) == 0.0)
    inner = np.zeros(len(x), dtype=bool)
    inner[1:-1] = still[:-1] & still[1:]
    return np.nonzero(~inner)[0]


def _crossing(tracks: Tracks, ego: _Index) -> _Index:
    """Sightings whose direction crosses one that the ego ever had, within reach of the ego's ground."""
    bins = 72
    width = 2 * math.pi / bins
    had = np.unique((tracks.heading[ego] // width).astype(np.int64) % bins)
    turn = np.abs((np.arange(bins)[:, None] - had[None] + bins // 2) % bins - bins // 2) * width
    crosses = (turn > PET_CROSSING_RAD - width).any(axis=1)
    keep = crosses[(tracks.pose[:, 2] // width).astype(np.int64) % bins]
    margin = EGO_LENGTH_M + tracks.length
    for k, line in enumerate((tracks.x, tracks.y)):
        keep &= (tracks.pose[:, k] >= line.min() - margin) & (tracks.pose[:, k] <= line.max() + margin)
    return np.nonzero(keep)[0]


def _near_pairs(a: Array, b: Array, reach: float) -> tuple[_Index, _Index]:
    """Pairs of rows of a and b that are at most `reach` apart in x and in y, from cells as wide as that."""
    key_a, key_b = ((xy // reach).astype(np.int64) @ (_CELLS, 1) for xy in (a, b))
    order = np.argsort(key_a, kind="stable")
    known = key_a[order]
    # The nine cells around each row of b: of each three that follow one another, one range of a's sorted keys.
    start = key_b + np.array([[-_CELLS], [0], [_CELLS]]) - 1
    first = np.searchsorted(known, start, side="left").ravel()
    count = np.searchsorted(known, start + 2, side="right").ravel() - first
    j = np.repeat(np.tile(np.arange(len(b)), 3), count)
    i = order[np.arange(len(j)) + np.repeat(first - (np.cumsum(count) - count), count)]
    near = np.abs(a[:, 0][i] - b[:, 0][j]) <= reach
    near &= np.abs(a[:, 1][i] - b[:, 1][j]) <= reach
    return i[near], j[near]


def _overlap(tracks: Tracks, i: _Index, k: _Index) -> npt.NDArray[np.bool_]:
    """Does the ego's footprint at ticks i overlap those of the sightings k? Separating axes, closed sets."""
    dx, dy = tracks.pose[k, 0] - tracks.x[i], tracks.pose[k, 1] - tracks.y[i]
    ca, sa = np.cos(tracks.heading[i]), np.sin(tracks.heading[i])
    cb, sb = np.cos(tracks.pose[k, 2]), np.sin(tracks.pose[k, 2])
    c, s = np.abs(ca * cb + sa * sb), np.abs(ca * sb - sa * cb)
    el, ew, al, aw = EGO_LENGTH_M, EGO_WIDTH_M, tracks.length[k], tracks.width[k]
    touch: npt.NDArray[np.bool_] = (
        (2.0 * np.abs(dx * ca + dy * sa) <= el + al * c + aw * s)
        & (2.0 * np.abs(dy * ca - dx * sa) <= ew + al * s + aw * c)
        & (2.0 * np.abs(dx * cb + dy * sb) <= al + el * c + ew * s)
        & (2.0 * np.abs(dy * cb - dx * sb) <= aw + el * s + ew * c)
    )
    return touch
