"""The centreline of the route, and fifteen ways along it: five wished speeds by three offsets. Units: m, rad, m/s, s.

Each proposal is driven by the Intelligent Driver Model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tsbench.bridges.nuplan.states import StateSE2
from tsbench.geometry.elementary import arctan2
from tsbench.geometry.polyline import Array

REACH_M = 150.0
_TOUCH_M = 1e-3
_BEND_MPS2 = 3.0
_BEND_M = 3.0
_BEND_BRAKE_MPS2 = 2.0


@dataclass(frozen=True)
class Centerline:
    """A line with arc lengths. xy: (n, 2); s: (n,); heading: (n - 1,) of its segments; unit: (n - 1, 2).

    left, right: (n - 1,) room of the road from the middle to either side, inf in junctions. limit: (n - 1,) what the
    road's class and the bends ahead allow, m/s. end: where its lanes end; behind that it goes straight on.
    """

    xy: Array
    s: Array
    heading: Array
    unit: Array
    left: Array
    right: Array
    limit: Array
    end: float

    def segment(self, s: Array) -> Any:
        return np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.heading) - 1)

    def place(self, s: Array, d: Array) -> tuple[Array, Array, Array]:
        """x, y and the line's heading at arc lengths s, d to the left; any shape."""
        k = self.segment(s)
        t = s - self.s[k]
        ux, uy = self.unit[k, 0], self.unit[k, 1]
        return self.xy[k, 0] + t * ux - d * uy, self.xy[k, 1] + t * uy + d * ux, self.heading[k]

    def project(self, x: Array, y: Array) -> tuple[Array, Array]:
        """(s, d) of points (m,); before the beginning s is negative."""
        seg = np.diff(self.s)
        px, py = x[:, None] - self.xy[:-1, 0], y[:, None] - self.xy[:-1, 1]
        along = px * self.unit[:, 0] + py * self.unit[:, 1]
        cut = np.clip(along, 0.0, seg)
        ex, ey = px - cut * self.unit[:, 0], py - cut * self.unit[:, 1]
        best = np.argmin(ex * ex + ey * ey, axis=1)
        rows = np.arange(len(x))
        t = along[rows, best]
        t = np.where((best > 0) & (t < 0.0), 0.0, t)
        t = np.where((best < len(seg) - 1) & (t > seg[best]), seg[best], t)
        d = self.unit[best, 0] * py[rows, best] - self.unit[best, 1] * px[rows, best]
        return self.s[best] + t, d


class Route:
    """The lanes of a route's roadblocks, and how many lane changes each still needs to the end of it."""

    def __init__(self, initialization: Any) -> None:
        roads, ids = initialization.map_api, list(dict.fromkeys(initialization.route_roadblock_ids))
        layers = {layer.name: layer for layer in roads.get_available_map_objects()}
        ordinary = [roads.get_map_object(name, layers["ROADBLOCK"]) for name in ids]
        joints = [roads.get_map_object(name, layers["ROADBLOCK_CONNECTOR"]) for name in ids]
        self.blocks = blocks = [a or b for a, b in zip(ordinary, joints, strict=True)]
        rooms = [
            {lane.id: _room(lane) if block else (math.inf, math.inf) for lane in (block or joint).interior_edges}
            for block, joint in zip(ordinary, joints, strict=True)
        ]
        self.rooms = {name: room for block in rooms for name, room in block.items()}
        self.changes: dict[str, float] = {}
        for k in range(len(blocks) - 1, -1, -1):
            self._count(blocks[k].interior_edges, last=k == len(blocks) - 1)

    def _count(self, lanes: list[Any], last: bool) -> None:
        leads = [
            0.0 if last else min((self._onward(out) for out in lane.outgoing_edges), default=math.inf) for lane in lanes
        ]
        # Connectors through a junction lie over each other, not side by side.
        beside = any(any(lane.adjacent_edges) for lane in lanes)
        for k, lane in enumerate(lanes):
            self.changes[lane.id] = min(cost + abs(j - k) for j, cost in enumerate(leads) if beside or j == k)

    def _onward(self, lane: Any) -> float:
        return self.changes.get(lane.id, math.inf)

    def start(self, x: float, y: float, heading: float) -> Any:
        """The lane to go along: the ego's, or the one beside it where that leads on and its own does not."""
        own = min(
            (lane for block in self.blocks for lane in block.interior_edges),
            key=lambda lane: (_far(lane, x, y, heading), self._onward(lane)),
        )
        beside = [lane for lane in own.adjacent_edges if lane is not None]
        return min([own, *beside], key=lambda lane: (self._onward(lane), lane is not own))

    def line(self, x: float, y: float, heading: float) -> Centerline:
        """The centreline from 10 m behind the ego on."""
        lane = self.start(x, y, heading)
        s0 = lane.baseline_path.get_nearest_arc_length_from_position(StateSE2(x, y, heading))
        chain, length = [lane], lane.baseline_path.length - s0
        while length < REACH_M:
            after = [out for out in chain[-1].outgoing_edges if self._onward(out) < math.inf]
            if not after:
                break
            chain.append(min(after, key=lambda out: (self._onward(out), out.lanes[0].order)))
            length += chain[-1].baseline_path.length
        return self._joined(chain, max(s0 - 10.0, 0.0))

    def _joined(self, chain: list[Any], start: float) -> Centerline:
        """Lanes one behind the other. start: how far along the first of them the line begins, m."""
        parts = [lane.baseline_path.line.points for lane in chain]
        xy = np.concatenate(parts)
        who = np.repeat(np.arange(len(chain)), [len(part) for part in parts])
        passed = np.concatenate((np.cumsum(_lengths(xy)) <= start, [False]))
        keep = np.concatenate(([True], _lengths(xy) > _TOUCH_M)) & ~passed
        xy, who = xy[keep], who[keep]
        if len(xy) < 2:
            xy, who = parts[-1][-2:], who[[-1, -1]]
        tail = xy[-1:] + (xy[-1:] - xy[-2:-1]) * (REACH_M / _lengths(xy[-2:])[0])
        xy, who = np.concatenate((xy, tail)), np.append(who, who[-1])
        seg = _lengths(xy)
        unit = np.diff(xy, axis=0) / seg[:, None]
        s = np.concatenate(([0.0], np.cumsum(seg)))
        room = np.array([self.rooms[lane.id] for lane in chain])[who[1:]]
        speeds = np.array([lane.speed_limit_mps for lane in chain])[who[1:]]
        heading = arctan2(unit[:, 1], unit[:, 0])
        limit = _with_bends(speeds, unit, s)
        return Centerline(xy, s, heading, unit, room[:, 0], room[:, 1], limit, float(s[-2]))


def _far(lane: Any, x: float, y: float, heading: float) -> float:
    """How far a pose is from a lane, m; one that goes another way is farther."""
    near = lane.baseline_path.get_nearest_pose_from_position(StateSE2(x, y, heading))
    turned = abs(math.remainder(heading - near.heading, 2.0 * math.pi))
    return math.sqrt((x - near.x) ** 2 + (y - near.y) ** 2) + 2.0 * turned


def _with_bends(limit: Array, unit: Array, s: Array) -> Array:
    """Limits that let the ego come to each bend at what it can be driven with. Bends are turns over 2 x 3 m."""
    middle = 0.5 * (s[:-1] + s[1:])
    before = np.clip(np.searchsorted(s, middle - _BEND_M, side="right") - 1, 0, len(unit) - 1)
    after = np.clip(np.searchsorted(s, middle + _BEND_M, side="right") - 1, 0, len(unit) - 1)
    # The chord between two unit vectors is the angle, for the bends that roads have.
    turn = _norm(unit[after] - unit[before])
    bend = np.sqrt(_BEND_MPS2 * 2.0 * _BEND_M / np.maximum(turn, 1e-6))
    found = np.minimum(limit, bend)
    for k in range(len(found) - 2, -1, -1):
        found[k] = min(found[k], math.sqrt(found[k + 1] ** 2 + 2.0 * _BEND_BRAKE_MPS2 * (s[k + 1] - s[k])))
    return found


def _room(lane: Any) -> tuple[float, float]:
    """(left, right) from a lane's middle to the edge of its side of the road, m."""
    rooms = []
    for side in (0, 1):
        room, beside = _width(lane) / 2, lane.adjacent_edges[side]
        while beside is not None:
            room += _width(beside)
            beside = beside.adjacent_edges[side]
        rooms.append(room)
    return rooms[0], rooms[1]


def _width(lane: Any) -> float:
    (ax, ay), (bx, by) = (side.line.points[0].tolist() for side in (lane.left_boundary, lane.right_boundary))
    return math.sqrt((ax - bx) ** 2 + (ay - by) ** 2)


def _lengths(xy: Array) -> Array:
    return _norm(np.diff(xy, axis=0))


def _norm(rows: Array) -> Array:
    found: Array = np.sqrt(rows[:, 0] * rows[:, 0] + rows[:, 1] * rows[:, 1])
    return found


STEP_S, STEPS = 0.2, 20
SHARES = (0.2, 0.4, 0.6, 0.8, 1.0)
OFFSETS_M = (-1.0, 0.0, 1.0)
# PDM-Closed's driver.
_HEADWAY_S, _GAP_M, _ACCEL_MPS2, _BRAKE_MPS2 = 1.5, 1.0, 1.5, 3.0
_HARDEST_MPS2 = 6.0
_LEAST_MPS = 0.5


@dataclass(frozen=True)
class Others:
    """What is around, forecast at constant velocity: (n, STEPS + 5) centres on a grid of STEP_S, four steps longer.

    x, y: world; s, d: on the centreline. (n,): along: speed along it; cos, sin: of the heading; length, width; still:
    a fixed thing.
    """

    x: Array
    y: Array
    s: Array
    d: Array
    along: Array
    cos: Array
    sin: Array
    length: Array
    width: Array
    still: npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Proposals:
    """(15, STEPS + 1) from now on: place on the centreline, speed, world pose."""

    s: Array
    d: Array
    speed: Array
    x: Array
    y: Array
    heading: Array


def roll_out(
    line: Centerline, s0: float, d0: float, speed: float, others: Others, length: float, width: float
) -> Proposals:
    """Drive all proposals along the centreline, each behind the leader that it has at that time.

    PDM-Closed simulates a car that tracks a proposal, and so learns who leaves a bend. Here the pose is the proposal's
    itself, and `Centerline.limit` bounds speeds in bends instead.
    """
    share = np.repeat(np.array(SHARES), len(OFFSETS_M))
    offset = np.tile(np.array(OFFSETS_M), len(SHARES))
    # The way over: it begins at a slope of a tenth or less and ends at none.
    over = np.maximum(np.maximum(10.0, 1.5 * speed), 20.0 * np.abs(offset - d0))
    s, v = np.full(len(share), s0), np.full(len(share), speed)
    rows_s, rows_v, rows_d = [s], [v], [np.full(len(share), d0)]
    for k in range(STEPS):
        d = _beside(s - s0, offset, d0, over)
        gap, lead = _leader(s, d, others, k, length, width)
        gap = np.maximum(np.minimum(gap, line.end + 100.0 - s), 0.1)
        top = np.maximum(share * line.limit[line.segment(s + 0.5 * v)], _LEAST_MPS)
        wish = _GAP_M + np.maximum(v * _HEADWAY_S + v * (v - lead) / (2.0 * np.sqrt(_ACCEL_MPS2 * _BRAKE_MPS2)), 0.0)
        free = (v / top) * (v / top)
        free = free * free * free * free * free
        pull = _ACCEL_MPS2 * (1.0 - free - (wish / gap) * (wish / gap))
        least = np.where(wish > gap, -_HARDEST_MPS2, -_BRAKE_MPS2)
        after = np.maximum(v + STEP_S * np.maximum(pull, least), 0.0)
        s = s + 0.5 * STEP_S * (v + after)
        v = after
        rows_s.append(s)
        rows_v.append(v)
        rows_d.append(_beside(s - s0, offset, d0, over))
    return posed(line, np.stack(rows_s, 1), np.stack(rows_d, 1), np.stack(rows_v, 1))


def stop(line: Centerline, s0: float, d0: float, speed: float) -> Proposals:
    """The one that brakes as hard as it may, in its place beside the line."""
    at = np.minimum(STEP_S * np.arange(STEPS + 1), speed / _HARDEST_MPS2)[None]
    s = s0 + speed * at - 0.5 * _HARDEST_MPS2 * at * at
    return posed(line, s, np.full(s.shape, d0), speed - _HARDEST_MPS2 * at)


def posed(line: Centerline, s: Array, d: Array, speed: Array) -> Proposals:
    """With world poses; the heading is the line's and what the change of d adds."""
    x, y, heading = line.place(s, d)
    ds, dd = np.diff(s, axis=1), np.diff(d, axis=1)
    slope = arctan2(np.where(ds > 1e-3, dd, 0.0), np.maximum(ds, 1e-3))
    return Proposals(s, d, speed, x, y, heading + np.concatenate((slope, slope[:, -1:]), axis=1))


def _beside(gone: Array, offset: Array, d0: float, over: Array) -> Array:
    left = 1.0 - np.minimum(gone / over, 1.0)
    found: Array = offset + (d0 - offset) * left * left
    return found


def _leader(s: Array, d: Array, o: Others, k: int, length: float, width: float) -> tuple[Array, Array]:
    """Gap to, and speed along the line of, the nearest road user in the way of each proposal; (inf, 0): none."""
    if not len(o.along):
        return np.full(len(s), np.inf), np.zeros(len(s))
    ahead = o.s[:, k] - s[:, None]
    gap = ahead - 0.5 * (length + o.length)
    inside = np.abs(o.d[:, k] - d[:, None]) < 0.5 * (width + o.width)
    gap = np.where(inside & (ahead > 0.0), gap, np.inf)
    who = np.argmin(gap, axis=1)
    rows = np.arange(len(s))
    return gap[rows, who], np.where(np.isfinite(gap[rows, who]), o.along[who], 0.0)
