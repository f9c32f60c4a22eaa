"""Shapes for planners: a path made ready for driving, the ego's limits, lanes as areas, the route as a line.

Made from what every planner is given, when it asks; some is exported by `tsbench`. Units: m, s, m/s, m/s2, rad.

The strip of road that the ego is about to sweep is a chain of discs, one at each metre of the path. A body is looked
for by sphere tracing (Hart 1996): where it is `d` away from the strip, the next `d` metres of the path cannot touch it.
That needs a few scalar steps a body.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tsbench.geometry.elementary import arctan2, wrap
from tsbench.geometry.polyline import Array, Polyline
from tsbench.planners.base import PlannerContext
from tsbench.planners.observation import Observation
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.road_map import MapLane, RoadMap
from tsbench.sim.ego import MAX_ACCEL_MPS2, MAX_DECEL_MPS2, MAX_SPEED_MPS, MAX_STEER_RAD, MAX_STEER_RATE_RAD_S
from tsbench.sim.scene import Obstacle
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M, WHEELBASE_M, Agents, Box

# Bends are measured over this length: netconvert draws a turn as a few chords, whose corners are no bends.
_BEND_WINDOW_M = 6
_SLOWEST_MPS = 1.5


class PathSamples:
    """Points of a path every metre, from its start.

    Attributes
    ----------
    x, y : m; cos, sin : direction of travel (plain lists, for scalar look-ups).
    curvature : (n,) 1/m, unsigned.
    last : index of the last sample.
    """

    __slots__ = ("cos", "curvature", "last", "sin", "x", "y")

    def __init__(self, path: RoutePath) -> None:
        line = path.line
        n = max(int(line.length), 2) + 1
        at = np.arange(n, dtype=np.float64)
        x, y = np.interp(at, line.s, line.points[:, 0]), np.interp(at, line.s, line.points[:, 1])
        dx, dy = np.diff(x), np.diff(y)
        heading = np.unwrap(arctan2(dy, dx))
        half = _BEND_WINDOW_M // 2
        padded = np.concatenate((np.full(half, heading[0]), heading, np.full(half + 1, heading[-1])))
        self.curvature: Array = np.abs(padded[2 * half : 2 * half + n] - padded[:n]) / (2 * half)
        norm = np.maximum(np.hypot(dx, dy), 1e-9)
        self.x: list[float] = x.tolist()
        self.y: list[float] = y.tolist()
        self.cos: list[float] = (dx / norm).tolist()
        self.sin: list[float] = (dy / norm).tolist()
        self.cos.append(self.cos[-1])
        self.sin.append(self.sin[-1])
        self.last = n - 1


def speed_profile(
    path: RoutePath, samples: PathSamples, *, lateral: float, decel: float, factor: float, top: float
) -> list[float]:
    """Greatest speed at each sample: bends at `lateral` m/s2, `factor` x the limit, at most `top`.

    Slower stretches are reached by braking at `decel` m/s2, which a backward pass over the path provides for.
    """
    at = np.arange(samples.last + 1, dtype=np.float64)
    where = np.maximum(np.searchsorted(path.limit_s, at + 1e-9, side="right") - 1, 0)
    bend = np.sqrt(lateral / np.maximum(samples.curvature, 1e-4))
    cap = np.maximum(np.minimum(np.minimum(bend, path.limit[where] * factor), top), _SLOWEST_MPS)
    speeds: list[float] = cap.tolist()
    for i in range(len(speeds) - 2, -1, -1):
        reachable = math.sqrt(speeds[i + 1] ** 2 + 2.0 * decel)
        speeds[i] = min(speeds[i], reachable)
    return speeds


def speed_at(speeds: list[float], s: float) -> float:
    """The profile at arc length s, between samples linearly."""
    i = int(s) if s > 0.0 else 0
    if i >= len(speeds) - 1:
        return speeds[-1]
    return speeds[i] + (s - i) * (speeds[i + 1] - speeds[i]) if s > 0.0 else speeds[0]


_LEAST_M = 1e-6


STRIP_HALF_M = EGO_WIDTH_M / 2 + 0.25
HALF_LENGTH_M = EGO_LENGTH_M / 2


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


def moving_ahead(samples: PathSamples, s: float, reach: float, actors: Agents) -> list[tuple[float, float]]:
    """Road users with a part in the strip from the front of an ego at `s` on, up to `reach` m.

    Each as (arc length of its nearest end, its speed along the path, not below 0).
    """
    found: list[tuple[float, float]] = []
    first = max(math.ceil(s + HALF_LENGTH_M + STRIP_HALF_M), 0)
    last = min(int(s + HALF_LENGTH_M + reach), samples.last)
    if first > last:
        return found
    x, y, sqrt = samples.x[first], samples.y[first], math.sqrt
    for row, box in enumerate(actors.boxes):
        # The first step of `first_contact`, taken here: most of them are farther away than the strip is long.
        dx, dy = x - box[0], y - box[1]
        away = sqrt(dx * dx + dy * dy) - 0.5 * (box[3] + box[4]) - STRIP_HALF_M
        start = first + int(away) if away >= 1.0 else first
        k = first_contact(samples, start, last, box) if start <= last else -1
        if k >= 0:
            along = math.cos(box[2]) * samples.cos[k] + math.sin(box[2]) * samples.sin[k]
            found.append((nearest_end(samples, k, box), max(float(actors.speed[row]) * along, 0.0)))
    return found


def obstacle_ahead(samples: PathSamples, s: float, obstacle: Obstacle) -> float:
    """Arc length of the near end of an obstacle that lies in the strip ahead of `s`, else infinity."""
    box = (obstacle.x, obstacle.y, obstacle.heading, obstacle.length, obstacle.width)
    k = first_contact(samples, max(int(s), 0), samples.last, box)
    return math.inf if k < 0 else nearest_end(samples, k, box)


def first_contact(samples: PathSamples, first: int, last: int, box: Box) -> int:
    """The first sample in [first, last] whose disc touches the box, or -1."""
    x, y, heading, length, width = box
    radius = 0.5 * (length + width) + STRIP_HALF_M
    half_l, half_w = 0.5 * length, 0.5 * width
    xs, ys = samples.x, samples.y
    c = s = 0.0
    turned = False
    k = first
    while k <= last:
        dx, dy = xs[k] - x, ys[k] - y
        d = math.sqrt(dx * dx + dy * dy) - radius
        if d < 1.0:
            if not turned:
                c, s, turned = math.cos(heading), math.sin(heading), True
            u = abs(c * dx + s * dy) - half_l
            v = abs(c * dy - s * dx) - half_w
            d = (math.sqrt(u * u + v * v) if u > 0.0 and v > 0.0 else max(u, v)) - STRIP_HALF_M
            if d <= 0.0:
                return k
        k += int(d) or 1
    return -1


def nearest_end(samples: PathSamples, k: int, box: Box) -> float:
    """Arc length of the box's nearest extent, measured along the path's direction at sample k."""
    x, y, heading, length, width = box
    c, s = samples.cos[k], samples.sin[k]
    along = (x - samples.x[k]) * c + (y - samples.y[k]) * s
    ch, sh = math.cos(heading), math.sin(heading)
    extent = 0.5 * (length * abs(ch * c + sh * s) + width * abs(sh * c - ch * s))
    # A long body that stands across reaches back beyond the strip: what counts is where it is first touched.
    return k + max(along - extent, -STRIP_HALF_M)
