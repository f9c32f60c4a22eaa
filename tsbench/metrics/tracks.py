"""An episode's snapshots as flat arrays, so that every metric is a few operations over the whole of it.

Units: m, s, m/s, rad. Made once per episode, after it has ended.
"""

from __future__ import annotations

from dataclasses import dataclass
from operator import attrgetter

import numpy as np
import numpy.typing as npt

from tsbench.geometry.polyline import Array
from tsbench.sim.world import WorldSnapshot

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
