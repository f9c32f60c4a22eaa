"""What the world looks like at one tick: frozen values and arrays, shared by planners, rules and records.

Frame: the network's own metres, x east, y north; headings in rad, counter-clockwise from +x; every pose is
the *centre* of a footprint. Lane numbers are `RoadNetwork.lanes` indices, -1 = none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from tsbench.geometry.polyline import Array

DT_S = 0.1
EGO_LENGTH_M = 4.515
EGO_WIDTH_M = 1.852
WHEELBASE_M = 2.469


# A footprint in plain numbers: x and y of its centre, heading, length, width.
Box = tuple[float, float, float, float, float]


class ActorKind(IntEnum):
    CAR = 0
    BUS = 1
    BICYCLE = 2
    PEDESTRIAN = 3


@dataclass(frozen=True, slots=True)
class EgoState:
    """The ego after a tick. `lane`, `s`, `d` are computed from geometry: the centre's place along `lane`.

    `on_road`: the centre is in some lane strip or junction area.
    """

    x: float
    y: float
    heading: float
    speed: float
    acceleration: float
    steering: float
    yaw_rate: float
    lane: int
    s: float
    d: float
    on_road: bool

    @property
    def front(self) -> tuple[float, float]:
        half = EGO_LENGTH_M / 2
        return self.x + half * math.cos(self.heading), self.y + half * math.sin(self.heading)


def ego_box(ego: EgoState) -> Box:
    return ego.x, ego.y, ego.heading, EGO_LENGTH_M, EGO_WIDTH_M


class ActorTable:
    """What stays the same of each road user of an episode; grows as they appear (row = `Actors.index`).

    ids: SUMO ids. kind: ActorKind values. length, width, longest: m. routes: edge ids in order (empty for persons).
    """

    def __init__(self, capacity: int = 256) -> None:
        self.ids: list[str] = []
        self.routes: list[tuple[str, ...]] = []
        self.rows: dict[str, int] = {}
        self.kind: npt.NDArray[np.int8] = np.zeros(capacity, dtype=np.int8)
        self.length: Array = np.zeros(capacity)
        self.width: Array = np.zeros(capacity)
        self.longest = 0.0

    def add(self, actor_id: str, kind: ActorKind, length: float, width: float, route: tuple[str, ...]) -> int:
        """Enter a road user; returns its row."""
        row = len(self.ids)
        if row == len(self.kind):
            self.kind = np.concatenate((self.kind, np.zeros_like(self.kind)))
            self.length = np.concatenate((self.length, np.zeros_like(self.length)))
            self.width = np.concatenate((self.width, np.zeros_like(self.width)))
        self.ids.append(actor_id)
        self.routes.append(route)
        self.rows[actor_id] = row
        self.kind[row], self.length[row], self.width[row] = kind, length, width
        self.longest = max(self.longest, length)
        return row


@dataclass(frozen=True, slots=True)
class Actors:
    """Other road users around the ego: vehicles, then pedestrians, each sorted by SUMO id.

    index: (n,) int32 rows of `table`. pose: (n, 3) x, y, heading. speed: (n,) m/s. lane: (n,) int32.
    lane_s: (n,) m, the *front's* place along `lane`.
    Pedestrians on a crossing are on no lane. known_boxes: `boxes`, where they are at hand.
    """

    table: ActorTable
    index: npt.NDArray[np.int32]
    pose: Array
    speed: Array
    lane: npt.NDArray[np.int32]
    lane_s: Array
    known_boxes: tuple[Box, ...] | None = field(default=None, repr=False, compare=False)

    def __len__(self) -> int:
        return len(self.index)

    @property
    def boxes(self) -> tuple[Box, ...]:
        """The n footprints as plain numbers: scalar look-ups in a tick are several times faster than in arrays."""
        if self.known_boxes is not None:
            return self.known_boxes
        sizes = zip(self.length.tolist(), self.width.tolist(), strict=True)
        return tuple((x, y, h, *size) for (x, y, h), size in zip(self.pose.tolist(), sizes, strict=True))

    @property
    def length(self) -> Array:
        """(n,) m."""
        return self.table.length[self.index]

    @property
    def width(self) -> Array:
        """(n,) m."""
        return self.table.width[self.index]

    @property
    def kind(self) -> npt.NDArray[np.int8]:
        """(n,) ActorKind values."""
        return self.table.kind[self.index]


class Indicator(IntEnum):
    NONE = 0
    LEFT = 1
    RIGHT = 2


@dataclass(frozen=True, slots=True)
class Agents:
    """Other road users as planners see them, in the order in which they came into sight; read-only.

    ids: (n,) int32, of no meaning but that they stay the same. pose: (n, 3) x, y, heading. speed: (n,) m/s. length,
    width: (n,) m. kind: (n,) ActorKind values. lane: (n,) int32 of the map, -1 = none. indicator: (n,) Indicator
    values. boxes: the n footprints as plain numbers.
    """

    ids: npt.NDArray[np.int32]
    pose: Array
    speed: Array
    length: Array
    width: Array
    kind: npt.NDArray[np.int8]
    lane: npt.NDArray[np.int32]
    indicator: npt.NDArray[np.int8]
    boxes: tuple[Box, ...]

    def __len__(self) -> int:
        return len(self.ids)

    @classmethod
    def none(cls) -> Agents:
        """Nobody in sight."""
        whole, small, real = np.zeros(0, dtype=np.int32), np.zeros(0, dtype=np.int8), np.zeros(0)
        return cls(
            ids=whole,
            pose=np.zeros((0, 3)),
            speed=real,
            length=real,
            width=real,
            kind=small,
            lane=whole,
            indicator=small,
            boxes=(),
        )


@dataclass(frozen=True, slots=True)
class WorldSnapshot:
    """The world after `step` control steps (step 0 = as spawned); `time` = step x 0.1 s."""

    step: int
    time: float
    ego: EgoState
    actors: Actors
