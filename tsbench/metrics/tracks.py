"""An episode as flat arrays: whole (`Tracks`, for metrics), and by road user (`Track`, for pages and exports).

Units: m, s, m/s, rad. Metrics are a few operations over all of an episode, made once after it has ended.
"""

from __future__ import annotations

from dataclasses import dataclass
from operator import attrgetter

import numpy as np
import numpy.typing as npt

from tsbench.episode.trace import Trace
from tsbench.geometry.polyline import Array
from tsbench.sim.world import ActorKind, WorldSnapshot

_EGO = attrgetter("x", "y", "heading", "speed", "acceleration", "yaw_rate", "lane")


@dataclass(frozen=True)
class Tracks:
    """The ego at each of n ticks, and each of the m sightings of another road user.

    x .. yaw_rate: (n,) of the ego; lane: (n,) lane index, -1 = none. tick, row: (m,) at which tick and which
    row of the actor table; pose: (m, 3); a_speed, length, width, kind: (m,).
    """

    x: Array
    y: Array
    heading: Array
    speed: Array
    acceleration: Array
    yaw_rate: Array
    lane: npt.NDArray[np.int64]
    tick: npt.NDArray[np.int64]
    row: npt.NDArray[np.int32]
    pose: Array
    a_speed: Array
    length: Array
    width: Array
    kind: npt.NDArray[np.int8]

    def __len__(self) -> int:
        return len(self.x)

    def in_ego_frame(self) -> tuple[Array, Array]:
        """(m,) forward and left coordinates of the others' centres, seen from the ego's centre."""
        c, s = np.cos(self.heading)[self.tick], np.sin(self.heading)[self.tick]
        dx, dy = self.pose[:, 0] - self.x[self.tick], self.pose[:, 1] - self.y[self.tick]
        return dx * c + dy * s, dy * c - dx * s


def tracks_of(snapshots: list[WorldSnapshot]) -> Tracks:
    """Flatten an episode. Needs at least one snapshot."""
    ego = np.array([_EGO(s.ego) for s in snapshots], dtype=np.float64)
    actors = [s.actors for s in snapshots]
    table = actors[-1].table
    row = np.concatenate([a.index for a in actors])
    x, y, heading, speed, acceleration, yaw_rate = ego[:, :6].T
    return Tracks(
        x,
        y,
        heading,
        speed,
        acceleration,
        yaw_rate,
        lane=ego[:, 6].astype(np.int64),
        tick=np.repeat(np.arange(len(actors)), [len(a.index) for a in actors]),
        row=row,
        pose=np.concatenate([a.pose for a in actors]),
        a_speed=np.concatenate([a.speed for a in actors]),
        length=table.length[row],
        width=table.width[row],
        kind=table.kind[row],
    )


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
    found = []
    for part in np.split(np.arange(len(tick)), breaks):
        if len(part):
            k, begins = int(user[part[0]]), int(tick[part[0]])
            length, width = float(table.length[k]), float(table.width[k])
            kind = ActorKind(int(table.kind[k]))
            found.append(Track(k, table.ids[k], kind, length, width, begins, rows[part]))
    return found


def ego_rows(trace: Trace) -> Array:
    """(ticks, 4): the ego's x, y (m), heading (rad), speed (m/s)."""
    return np.array([(s.ego.x, s.ego.y, s.ego.heading, s.ego.speed) for s in trace.snapshots])
