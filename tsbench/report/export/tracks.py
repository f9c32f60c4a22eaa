"""What formats share: each road user's stretches of ticks, without holes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsbench.geometry.polyline import Array
from tsbench.run.trace import Trace
from tsbench.sim.world import ActorKind


@dataclass(frozen=True)
class Track:
    """A road user over consecutive ticks. first: tick of the first row; rows: (n, 4) x, y (m), heading, speed (m/s)."""

    name: str
    kind: ActorKind
    length: float
    width: float
    first: int
    rows: Array


def actor_tracks(trace: Trace) -> list[Track]:
    """All other road users, by name and time; who leaves the ego's surroundings and comes back has several tracks."""
    seen: dict[int, list[tuple[int, Array]]] = {}
    for tick, snapshot in enumerate(trace.snapshots):
        actors = snapshot.actors
        rows = np.column_stack((actors.pose, actors.speed))
        for index, row in zip(actors.index.tolist(), rows, strict=True):
            seen.setdefault(index, []).append((tick, row))
    table = trace.snapshots[-1].actors.table
    tracks = []
    for index in sorted(seen, key=lambda i: table.ids[i]):
        ticks = np.array([tick for tick, _ in seen[index]])
        for part in np.split(np.arange(len(ticks)), np.nonzero(np.diff(ticks) > 1)[0] + 1):
            rows = np.array([seen[index][k][1] for k in part])
            tracks.append(
                Track(
                    table.ids[index],
                    ActorKind(int(table.kind[index])),
                    float(table.length[index]),
                    float(table.width[index]),
                    int(ticks[part[0]]),
                    rows,
                )
            )
    return tracks


def ego_rows(trace: Trace) -> Array:
    """(ticks, 4): the ego's x, y, heading, speed."""
    return np.array([(s.ego.x, s.ego.y, s.ego.heading, s.ego.speed) for s in trace.snapshots])
