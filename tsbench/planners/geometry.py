"""Shapes for planners of one's own, exported by `tsbench`: the ego's limits, lanes as areas, the route as a line.

Made from what every planner is given, when it asks. Units: m, s, m/s, m/s2, rad.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tsbench.geometry.angles import wrap
from tsbench.geometry.polyline import Array, Polyline
from tsbench.planners.base import Observation, PlannerContext
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.road_map import MapLane, RoadMap
from tsbench.sim.ego import MAX_ACCEL_MPS2, MAX_DECEL_MPS2, MAX_SPEED_MPS, MAX_STEER_RAD, MAX_STEER_RATE_RAD_S
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M, WHEELBASE_M, Agents

_LEAST_M = 1e-6


@dataclass(frozen=True, slots=True)
class Vehicle:
    """A car, its pose that of the footprint's centre, the axles half a wheelbase before and behind it.

    steering, steering_rate: the most to either side (rad, rad/s); acceleration, braking: the most, both positive.
    """

    length: float = EGO_LENGTH_M
    width: float = EGO_WIDTH_M
    wheelbase: float = WHEELBASE_M
    top_speed: float = MAX_SPEED_MPS
    acceleration: float = MAX_ACCEL_MPS2
    braking: float = MAX_DECEL_MPS2
    steering: float = MAX_STEER_RAD
    steering_rate: float = MAX_STEER_RATE_RAD_S


EGO = Vehicle()


def lane_bounds(lane: MapLane) -> tuple[Array, Array]:
    """A lane's left and right boundary, (n, 2) points each, in the direction of travel."""
    return lane.line.beside(lane.width / 2), lane.line.beside(-lane.width / 2)


def lane_polygon(lane: MapLane) -> Array:
    """A lane's area, (2n, 2) points: along its left boundary, and back along the right one."""
    left, right = lane_bounds(lane)
    return np.concatenate((left, right[::-1]))


def route_lanes(path: RoutePath) -> tuple[int, ...]:
    """The lanes (indices) of a route in order, paths through junctions too; of a lane change the new one."""
    lanes = [piece.lane for piece in path.pieces]
    return tuple(lane for k, lane in enumerate(lanes) if k == 0 or lane != lanes[k - 1])


@dataclass(frozen=True, slots=True)
class RouteLine:
    """The route as one line that begins behind the ego and ends past the destination.

    start, destination_s: where on it the navigation's own line begins, and where the destination is. So the ego is at
    `start + observation.route.s` as long as the route stands.
    """

    line: Polyline
    start: float
    destination_s: float


def route_line(
    context: PlannerContext, observation: Observation, behind: float = 30.0, past: float = 30.0
) -> RouteLine:
    """The route from `behind` m before its beginning to at least `past` m behind the destination.

    It is continued along the lanes that lead there straightest, and straight on without lanes. Make it once for
    each `observation.route.path`.
    """
    path, graph = observation.route.path, context.graph
    x, y = path.line.points[0].tolist()
    beside = context.network.edges.get(graph.edge_of(path.pieces[0].lane))
    # Where the route begins with a lane change, it begins on another lane than it names.
    lane = min(beside.lanes if beside else (path.pieces[0].lane,), key=lambda k: abs(graph.line_of(k).project(x, y)[1]))
    own = graph.line_of(lane)
    at = own.project(x, y)[0]
    tail = _onward(context.network, lane, behind - at, back=True)[::-1]
    if at > _LEAST_M:
        tail = np.concatenate((tail, own.slice(max(at - behind, 0.0), at).points[:-1]))
    missing = past - (path.line.length - path.destination_s)
    head = _onward(context.network, path.pieces[-1].lane, missing, back=False)
    line = Polyline(np.concatenate((tail, path.line.points, head)))
    start = float(line.s[-1 - len(head)]) - path.line.length
    # A slice goes straight on where no lane does.
    end = start + max(path.line.length, path.destination_s + past)
    return RouteLine(line.slice(start - behind, end), behind, behind + path.destination_s)


def _onward(roads: RoadMap, lane: int, reach: float, *, back: bool) -> Array:
    """(n, 2) points of the `reach` m behind the end of a lane, away from it; back: of those before its start."""
    parts, seen = [np.zeros((0, 2))], {lane}
    while reach > _LEAST_M:
        lane = _straightest(roads, lane, back=back)
        if lane < 0 or lane in seen:
            break
        seen.add(lane)
        line = roads.lanes[lane].line
        some = min(reach, line.length)
        part = line.slice(line.length - some, line.length) if back else line.slice(0.0, some)
        parts.append(part.points[-2::-1] if back else part.points[1:])
        reach -= some
    return np.concatenate(parts)


def _straightest(roads: RoadMap, lane: int, *, back: bool) -> int:
    """Of the lanes behind one (back: before) that at whose far end the heading has changed least, or -1."""
    steps = (pairwise((c.from_lane, *c.via, c.to_lane)) for c in roads.connections)
    others = {(a if back else b) for way in steps for a, b in way if lane == (b if back else a)}

    def heading(k: int) -> float:
        line = roads.lanes[k].line
        return line.heading_at(0.0 if back else line.length)

    return min(others, key=lambda other: (abs(wrap(heading(other) - heading(lane))), other), default=-1)


class ActorHistory:
    """Where the others were in the last 2 s. Make one per episode, in `reset`; tell it every observation, in order.

    ticks: how many are kept, the present one included.
    """

    def __init__(self, ticks: int = 20) -> None:
        self._ticks: deque[Agents] = deque(maxlen=ticks)

    def update(self, observation: Observation) -> Array:
        """(n, ticks, 4) x, y, heading, speed of `observation.actors`, oldest first; NaN where one was not in sight."""
        self._ticks.append(observation.actors)
        row = {name: k for k, name in enumerate(observation.actors.ids.tolist())}
        found = np.full((len(row), self._ticks.maxlen or 0, 4), np.nan)
        for back, seen in enumerate(reversed(self._ticks), start=1):
            pairs = [(row[name], k) for k, name in enumerate(seen.ids.tolist()) if name in row]
            if pairs:
                to, out_of = (list(side) for side in zip(*pairs, strict=True))
                found[to, -back, :3], found[to, -back, 3] = seen.pose[out_of], seen.speed[out_of]
        return found
