"""What formats share: each road user's stretches of ticks, without holes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsbench.episode.trace import Trace
from tsbench.geometry.polyline import Array
from tsbench.sim.world import ActorKind


@dataclass(frozen=True)
class Track:
    """A road user over consecutive ticks.

    index: in the trace's table, -1 for the ego; first: tick of the first row; rows: (n, 4) x, y (m), heading, speed
    (m/s).
    """

    index: int
    name: str
    kind: ActorKind
    length: float
    width: float
    first: int
    rows: Array


def actor_tracks(trace: Trace) -> list[Track]:
    """All other road users, by name and time; who leaves the ego's surroundings and comes back has several tracks."""
    snapshots = trace.snapshots
    table = snapshots[-1].actors.table
    tick = np.repeat(np.arange(len(snapshots)), [len(s.actors) for s in snapshots])
    user = np.concatenate([s.actors.index for s in snapshots]).astype(np.int64)
    rows = np.concatenate([np.column_stack((s.actors.pose, s.actors.speed)) for s in snapshots])
    # Users by name, each in the order of time.
    rank = np.argsort(np.argsort(np.array(table.ids)))
    order = np.lexsort((tick, rank[user]))
    tick, user, rows = tick[order], user[order], rows[order]
    breaks = np.flatnonzero((np.diff(user) != 0) | (np.diff(tick) != 1)) + 1
    return [
        Track(
            int(user[part[0]]), table.ids[user[part[0]]], ActorKind(int(table.kind[user[part[0]]])),
            float(table.length[user[part[0]]]), float(table.width[user[part[0]]]), int(tick[part[0]]), rows[part],
        )
        for part in np.split(np.arange(len(tick)), breaks)
        if len(part)
    ]  # fmt: skip


def ego_rows(trace: Trace) -> Array:
    """(ticks, 4): the ego's x, y (m), heading (rad), speed (m/s)."""
    return np.array([(s.ego.x, s.ego.y, s.ego.heading, s.ego.speed) for s in trace.snapshots])
