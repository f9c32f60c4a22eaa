"""The map that a planner is given: what can be seen of a road network, and nothing of what plates decide there.

No priorities, rights of way, junction types, permissions or closures; limits are the defaults of road classes; one
path for each connection, and no edge is cut where nothing but a plate is. `roads.planner_map` makes it of a network.
Units: m, m/s, rad.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from tsbench.geometry.polyline import Array, Polyline


@dataclass(frozen=True, slots=True)
class MapLane:
    """A lane, or (`internal`) the path of a connection through a junction, which is on no edge (`edge` is "").

    index: its place in `RoadMap.lanes`. order: within the edge, 0 = at the kerb. line: middle line, in the direction of
    travel. width: m. speed: limit in m/s. left, right: indices of the lanes beside it, -1 = none.
    """

    index: int
    id: str
    edge: str
    order: int
    line: Polyline
    width: float
    speed: float
    internal: bool
    left: int = -1
    right: int = -1


@dataclass(frozen=True, slots=True)
class MapEdge:
    """A road in one direction, from one junction (id) to the next. lanes: indices, from the kerb on. length: m."""

    id: str
    source: str
    target: str
    lanes: tuple[int, ...]
    internal: bool
    length: float


@dataclass(frozen=True, slots=True)
class MapConnection:
    """From a lane to a lane (indices) behind a junction; `via`: the path between them, () where they touch."""

    from_lane: int
    to_lane: int
    via: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class MapJunction:
    """A junction, its middle and its area, (k, 2) points."""

    id: str
    x: float
    y: float
    polygon: Array


@dataclass(frozen=True, slots=True)
class Crossing:
    """A place where people cross `edges`: its middle line from kerb to kerb, and its width in m."""

    id: str
    edges: tuple[str, ...]
    line: Polyline
    width: float


@dataclass(frozen=True)
class RoadMap:
    """Lanes by index; edges, junctions, crossings by id; `outgoing[lane]` = the connections from it.

    left_hand: traffic keeps to the left, so an edge's lane at the kerb is its leftmost, else its rightmost.
    """

    lanes: tuple[MapLane, ...]
    lane_index: Mapping[str, int]
    edges: Mapping[str, MapEdge]
    junctions: Mapping[str, MapJunction]
    connections: tuple[MapConnection, ...]
    outgoing: tuple[tuple[MapConnection, ...], ...]
    crossings: Mapping[str, Crossing]
    left_hand: bool = field(default=False, kw_only=True)

    @property
    def kerb_side(self) -> str:
        """The side that traffic keeps to, "left" or "right"."""
        return "left" if self.left_hand else "right"

    @property
    def to_kerb(self) -> float:
        """The sign of an offset from a line (left positive) that leads to the kerb: 1 or -1."""
        return 1.0 if self.left_hand else -1.0

    def inner(self, lane: MapLane) -> int:
        """The lane (index) beside one, away from the kerb; -1 = none."""
        return lane.right if self.left_hand else lane.left

    def outer(self, lane: MapLane) -> int:
        """The lane (index) beside one, towards the kerb; -1 = none."""
        return lane.left if self.left_hand else lane.right

    def lane(self, lane_id: str) -> MapLane:
        """The lane with this id."""
        return self.lanes[self.lane_index[lane_id]]

    def edge_lanes(self, edge_id: str) -> tuple[MapLane, ...]:
        """Lanes of an edge, from the kerb on."""
        return tuple(self.lanes[i] for i in self.edges[edge_id].lanes)


def lanes_beside(index: int, order: int, count: int, left_hand: bool) -> dict[str, int]:
    """The lanes `left` and `right` of a lane (index), number `order` of `count` from the kerb; -1 = none."""
    outer, inner = index - 1 if order else -1, index + 1 if order + 1 < count else -1
    return {"left": outer, "right": inner} if left_hand else {"left": inner, "right": outer}
