"""Where vehicles with priority are on their paths through a junction: from lane, place and route. Units: m, m/s."""

from __future__ import annotations

import math
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from tsbench.geometry.polyline import Array
from tsbench.roads.junction_paths import JunctionPath
from tsbench.roads.network import RoadNetwork


class PriorityVehicle(NamedTuple):
    """A vehicle with priority at one tick.

    at: its place among the road users of the tick. row: in their table. path: which path it takes. s: its front's place
    on that path, negative before its line. length: m. speed: m/s.
    """

    at: int
    row: int
    path: int
    s: float
    length: float
    speed: float


@dataclass(frozen=True, slots=True)
class Following:
    """How a vehicle is placed on a path before it is on the path's own lanes.

    scaled: a lane's metres are those of its drawn line, SUMO's are scaled to it; else SUMO's own (they differ by less
    than a centimetre a lane). upstream_m: how far before the line it is looked for. onward: of the paths that it may
    take, only those whose lane leads on to where it goes behind the junction, if there is one. leftmost: where several
    connections lead from one lane or edge to the next, the leftmost one counts; else the rightmost one's path, and the
    longest one's length.
    """

    scaled: bool
    upstream_m: float
    onward: bool
    leftmost: bool


# What they differ in shows only before the junction: on its path a vehicle is in the same place for both, to a
# centimetre. 150 m is farther than a snapshot reaches.
RULE_FOLLOWING = Following(scaled=True, upstream_m=150.0, onward=False, leftmost=True)
EXPERT_FOLLOWING = Following(scaled=False, upstream_m=math.inf, onward=True, leftmost=False)

# On a lane: path, the path's coordinate of the lane's start, metres per SUMO metre.
_Place = tuple[int, float, float]


class _Table(Protocol):
    length: Array
    routes: list[tuple[str, ...]]


class RoadUsers(Protocol):
    """What is read of the road users of one tick: as `tsbench.sim.world.Actors` has it."""

    @property
    def table(self) -> _Table:
        """Lengths (m) and routes by row."""

    @property
    def index(self) -> npt.NDArray[np.int32]:
        """(n,) rows of the table."""

    @property
    def lane(self) -> npt.NDArray[np.int32]:
        """(n,) lane index, -1 on none."""

    @property
    def lane_s(self) -> Array:
        """(n,) the front's place along its lane, in SUMO's metres."""

    @property
    def speed(self) -> Array:
        """(n,) m/s."""


class PriorityVehicles:
    """Finds the vehicles that come, or have come, through the junction on one of the given paths.

    A vehicle's way is settled when it is first seen: its route does not change. only: lanes on which vehicles count;
    None: on all.
    """

    def __init__(
        self,
        network: RoadNetwork,
        paths: Sequence[JunctionPath],
        following: Following,
        only: AbstractSet[int] | None = None,
    ) -> None:
        self._network, self._paths, self._following, self._only = network, paths, following, only
        self._plans: dict[int, dict[int, _Place]] = {}

    def find(self, actors: RoadUsers) -> list[PriorityVehicle]:
        """The vehicles with priority among the road users of a tick, in their order."""
        found = []
        plans, table = self._plans, actors.table
        rows, lanes = actors.index.tolist(), actors.lane.tolist()
        places, speeds = actors.lane_s.tolist(), actors.speed.tolist()
        for at, row in enumerate(rows):
            plan = plans.get(row)
            if plan is None:
                plan = plans[row] = self._plan(table.routes[row])
            place = plan.get(lanes[at])
            if place is not None:
                path, start, scale = place
                s = start + scale * places[at]
                found.append(PriorityVehicle(at, row, path, s, float(table.length[row]), speeds[at]))
        return found

    def _plan(self, route: tuple[str, ...]) -> dict[int, _Place]:
        """For each lane of a way near the junction, its place on its path."""
        plan: dict[int, _Place] = {}
        for k in range(len(route) - 1):
            mine = [j for j, p in enumerate(self._paths) if (p.source.edge, p.target.edge) == route[k : k + 2]]
            if mine:
                self._through(mine, plan)
                self._before(self._leading_on(mine, route[k + 2 : k + 3]), route[: k + 1], plan)
        if self._only is None:
            return plan
        return {lane: place for lane, place in plan.items() if lane in self._only}

    def _through(self, mine: list[int], plan: dict[int, _Place]) -> None:
        """Places in the junction and on the edge behind it."""
        paths = self._paths
        targets = {j: paths[j].target.index for j in mine}
        for lane in self._network.edge_lanes(paths[mine[0]].target.edge):
            j = self._nearest(targets, lane.order)
            plan[lane.index] = (j, paths[j].line.length, self._scale(lane.index))
        for j in mine:
            at = 0.0
            for inner in paths[j].inner:
                plan[inner.index] = (j, at, self._scale(inner.index))
                at += inner.line.length

    def _before(self, mine: list[int], upstream: tuple[str, ...], plan: dict[int, _Place]) -> None:
        """Places on the edges before the line, and in the junctions between these."""
        lanes, sources = self._network.lanes, {j: self._paths[j].source.index for j in mine}
        end = 0.0
        for k in range(len(upstream) - 1, -1, -1):
            edge = self._network.edges[upstream[k]]
            for i in edge.lanes:
                j = self._nearest(sources, lanes[i].order)
                plan[i] = (j, end - lanes[i].line.length, self._scale(i))
            end -= lanes[edge.lanes[0]].line.length if self._following.scaled else edge.length
            if k == 0 or end < -self._following.upstream_m:
                break
            end = self._between(upstream[k - 1], upstream[k], end, plan)

    def _leading_on(self, mine: list[int], onward: tuple[str, ...]) -> list[int]:
        """Those of a vehicle's possible paths whose lane leads on to where it goes next: it may change to them."""
        lanes, outgoing = self._network.lanes, self._network.outgoing
        leading = [
            j
            for j in (mine if self._following.onward else ())
            if any(lanes[c.to_lane].edge in onward for c in outgoing[self._paths[j].target.index])
        ]
        return leading or mine

    def _between(self, source: str, target: str, end: float, plan: dict[int, _Place]) -> float:
        """Places on the internal lanes between two upstream edges; returns where `source` ends."""
        lanes, start, longest = self._network.lanes, end, 0.0
        for i in self._network.edges[source].lanes:
            for connection in self._network.outgoing[i]:
                if lanes[connection.to_lane].edge != target:
                    continue
                at = end
                for via in reversed(connection.via):
                    at -= lanes[via].line.length
                    plan[via] = (plan[connection.to_lane][0], at, self._scale(via))
                start, longest = at, max(longest, end - at)
        return start if self._following.leftmost else end - longest

    def _nearest(self, lane_of: dict[int, int], order: int) -> int:
        """Of paths by one lane of each, that whose lane is nearest in its edge, the rightmost of equally near ones."""
        lanes, last = self._network.lanes, -1 if self._following.leftmost else 1
        return min(lane_of, key=lambda j: (abs(lanes[lane_of[j]].order - order), lane_of[j], last * j))

    def _scale(self, lane: int) -> float:
        """Metres per metre of SUMO's lane length."""
        one = self._network.lanes[lane]
        return one.line.length / one.length if self._following.scaled and one.length > 0.0 else 1.0
