"""Speed scenes: a plate that binds the speed, on a straight corridor, or a minimum speed (4.6) ahead of a slow driver.

Source: docs/scenes.md, "Speed zones", "Minimum speed".
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from tsbench.geometry.polyline import bend_speed, join
from tsbench.make.city import types_file
from tsbench.make.maps.plain import PlainNet, class_speeds, split_edge
from tsbench.make.placements.placement import (
    Arrangement,
    ScenePlacement,
    SceneTask,
    passenger_lanes,
    plate_beside,
    require,
)
from tsbench.make.scenes.recipe import INITIAL_SPEEDS_MPS, Recipe
from tsbench.roads.lane_graph import Destination
from tsbench.roads.network import RoadNetwork
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.annotations import DISTRACTOR, SignInstance
from tsbench.signs.catalog import Catalog
from tsbench.signs.contrast import ContrastClause, SlowZoneParams
from tsbench.signs.rule_kinds import ZoneParams
from tsbench.sim.scene import EgoStart
from tsbench.sim.world import EGO_LENGTH_M

KMH = 1.0 / 3.6
# From a plate of the other direction to the ends of its edge.
_ROOM_M = 2.0


def braking_room(recipe: Recipe, v0: float, v: float) -> float:
    """The way before a plate in which the recipe's braking, half a second later, slows the ego from v0 to v; m."""
    return (v0 * v0 - v * v) / (2 * recipe.number("brake_mps2")) + 0.5 * v0 + 3.0


def fastest_before(recipe: Recipe, room: float, v: float) -> float:
    """The speed from which a way of so many m before a plate suffices to slow down to v, m/s (`braking_room`)."""
    brake = recipe.number("brake_mps2")
    return brake * (math.sqrt(max(0.25 + 2.0 / brake * (room - 3.0) + (v / brake) ** 2, 0.0)) - 0.5)


def can_post(recipe: Recipe, row: PoolRow, code: str, value: float) -> bool:
    """Can a plate set this value on a road of the map's class?"""
    sign, allowed = recipe.catalog.sign(code), recipe.catalog.allowed_speeds(road_class=row.road_class, code=code)
    value = sign.effective_value(value) or value
    return "road_speed" not in sign.places or allowed is None or value in allowed


def _bend_kmh(catalog: Catalog, network: RoadNetwork, zone: Sequence[str]) -> float:
    """The speed that the bends of a zone allow where it is judged how fast the ego is."""
    t = catalog.needless.thresholds
    line = join([network.edge_lanes(e)[0].line for e in zone])
    judged = line.slice(0.0, min(t["slow_zone_m"], line.length))
    return bend_speed(judged, t["lateral_mps2"]) / KMH


class SpeedZonePlacement(ScenePlacement):
    """`speed_limit`: a limit ahead of a driver who is too fast for it.

    The plate stands where the zone's first edge starts, the end plate where the edge behind the zone does. In the
    contrast half a higher value is posted. All values are those of the road's class. No other vehicle drives in the
    ego's direction; oncoming vehicles keep to the lower limit in both halves, because the other half's plates face
    them. Other traffic thus breaks no plate and does not reveal what is posted.
    """

    # Numbers of the recipe that add up to the room behind the zone.
    behind_zone: Sequence[str] = ("end_plate_before_destination_m", "end_before_edge_m")
    # Does the ego's way end in the zone, or behind it?
    ends_in_zone = False

    def __init__(self, recipe: Recipe) -> None:
        super().__init__(recipe)
        self.end_code = recipe.type.end_codes[0]
        self.other_codes = recipe.choices.get("contrast_plates", [self.code, self.end_code])

    def _cuts(self, row: PoolRow, recipe: Recipe) -> list[float]:
        """Arc lengths on the corridor: plate, borders of edges within the zone, end plate."""
        length = row.length_m
        end = length - sum(map(recipe.number, self.behind_zone))
        plate = min(end - recipe.number("zone_m"), recipe.number("plate_at_most_m"))
        require(plate >= recipe.number("plate_at_least_m"), f"the corridor is {length:.0f} m long")
        return [float(s) for s in np.linspace(plate, end, int(recipe.number("zone_edges")) + 1)]

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The zone on edges of its own, on a road whose traffic drives as its class lets a driver expect."""
        require(not row.oneway, "no other direction, where the other half's plates face")
        expected = class_speeds(types_file(plain.data)).get(f"highway.{row.road_class}", math.nan)
        require(abs(row.speed_mps - expected) < KMH, f"{row.speed_mps / KMH:.0f} km/h is no limit of its class")
        return split_edge(plain, row.fields["edge"], self._cuts(row, recipe))[0]

    def place(self, task: SceneTask) -> Arrangement:
        """The ego so far before the plate that 3.5 m/s2 after half a second suffices."""
        row, network, recipe, variant = task.row, task.network, task.recipe, task.variant
        edges = [f"{row.fields['edge']}.{k}" for k in range(int(recipe.number("zone_edges")) + 2)]
        first, zone, last = edges[0], edges[1:-1], edges[-1]
        bend, limits = _bend_kmh(recipe.catalog, network, zone), self.limits(row, recipe)
        # An ego at a limit is needlessly slow in the other half only where the road allows so much more.
        tolerated = max(limits) + recipe.catalog.rule("speed").thresholds["tolerance_kmh"]
        needed = tolerated / recipe.catalog.needless.thresholds["slow_speed_ratio"]
        require(needed <= bend, f"the zone has a bend for {bend:.0f} km/h")
        limit = float(limits[variant.value % len(limits)])
        v = limit * KMH
        lanes = passenger_lanes(network, first)
        lane = lanes[variant.layout % len(lanes)]
        excess = max(recipe.number("least_excess_mps"), variant.initial_speed)
        v0 = min(v + excess, v + recipe.number("most_excess_kmh") * KMH, self.before(task, limit))
        need = braking_room(recipe, v0, v)
        room = lane.line.length - need - EGO_LENGTH_M - recipe.number("start_behind_m")
        require(room >= 0.0, f"no room to brake from {v0:.1f} m/s before the plate")
        jitter = float(task.rng.uniform(0.0, min(recipe.number("jitter_m"), room)))
        before = recipe.numbers.get("ego_before_plate_m", need + jitter)
        start = EgoStart(lane.id, lane.line.length - before - EGO_LENGTH_M / 2, v0)
        way = tuple(zone) if self.ends_in_zone else (*zone, last)
        least = recipe.number("destination_behind_m")
        room = network.edge_lanes(way[-1])[0].line.length - 3.0
        require(room > least, "no room for the destination")
        end_s = variant.route_end(least, room)
        driven = sum(network.edges[e].length for e in way[:-1]) + end_s
        return Arrangement(
            signs=self._signs(task, zone, last, limit),
            targets=("sign_0",),
            start=start,
            destination=Destination(way[-1], end_s),
            route_hint=(first, *way),
            route_length=driven,
            drivers=tuple(replace(d, speed=min(d.speed, v)) for d in task.drivers),
            closed_edges=frozenset(edges),
        )

    def limits(self, row: PoolRow, recipe: Recipe, posted: Collection[float] = ()) -> list[float]:
        """The limits that can be posted on a map's road, with another in the contrast half. Raises UnfitMapError.

        posted: km/h; values of other plates there, which the contrast half does not repeat.
        """
        road = row.speed_mps / KMH
        most = road - recipe.number("below_road_kmh") + 0.5
        limits = [
            v
            for v in recipe.choices["limits_kmh"]
            if v <= most and can_post(recipe, row, self.code, v) and self._others(row, recipe, v, posted)
        ]
        require(bool(limits), f"no pair of limits for a {row.road_class} road of {road:.0f} km/h")
        return limits

    def before(self, task: SceneTask, limit: float) -> float:  # noqa: ARG002
        """How fast the ego may come to a plate of this limit, m/s."""
        return task.row.speed_mps

    def _signs(self, task: SceneTask, zone: Sequence[str], last: str, limit: float) -> tuple[SignInstance, ...]:
        """The plate and its end; what faces the other direction comes with the other half's plates."""
        return (
            plate_beside(task.network, self.code, zone[0], 0.0, ZoneParams((*zone, last)), value=limit),
            plate_beside(task.network, self.end_code, last, 0.0, number=1, role="end", value=limit, ends="sign_0"),
        )

    def _others(self, row: PoolRow, recipe: Recipe, limit: float, posted: Collection[float]) -> list[float]:
        """Values of the contrast half for a limit, km/h."""
        least = recipe.number("contrast_ratio") * limit - 0.5
        code = self.other_codes[0]
        above = (v for v in recipe.choices["contrast_kmh"] if v >= least and v not in posted)
        return [v for v in above if can_post(recipe, row, code, v)]

    def contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement:
        """A value of at least 1.6 times as much."""
        first = signed.signs[0]
        limit, value = first.posted, self.other(task, first.posted)
        zone = first.params_as(ZoneParams).zone_edges[:-1]
        length = sum(task.network.edge_lanes(e)[0].line.length for e in zone)
        slow = SlowZoneParams(zone, 0.0, length, min(value, task.row.speed_mps / KMH))
        begin, end = self.other_codes
        other = {(self.code, limit): (begin, value), (self.end_code, limit): (end, value)}
        swap = other | {theirs: ours for ours, theirs in other.items()}
        hung = ((sign, *swap[sign.code, sign.posted]) for sign in signed.signs)
        signs = tuple(replace(sign, code=code, value=value) for sign, code, value in hung)
        return replace(signed, signs=signs, contrast=(ContrastClause("needless_slow", slow),))

    def other(self, task: SceneTask, limit: float, posted: Collection[float] = ()) -> float:
        """The value of the contrast half, km/h. posted: as of `limits`."""
        values = self._others(task.row, task.recipe, limit, posted)
        return float(values[task.variant.plate % len(values)])


class ZonePlacement(SpeedZonePlacement):
    """`zone_speed_limit`, `residential_zone`: the ego's zone begins where another one ends, in which it starts.

    Both go on beyond the map. At their border hang the begins of both, each facing the traffic that enters its zone,
    and where they are of two kinds the end of the other one before each. In the contrast half the zones are exchanged.
    """

    behind_zone = ("end_before_edge_m",)
    ends_in_zone = True

    def _signs(self, task: SceneTask, zone: Sequence[str], last: str, limit: float) -> tuple[SignInstance, ...]:
        """The target, and beside it the begin of the other zone."""
        network, (facing, there) = task.network, self.across(task, zone[0], 0.0)
        (begin, end), theirs = self.other_codes, self.other(task, limit)
        target = plate_beside(network, self.code, zone[0], 0.0, ZoneParams((*zone, last)), value=limit)
        hung = [(begin, facing, there, theirs)]
        if begin != self.code:
            before, apart = f"{task.row.fields['edge']}.0", task.recipe.number("end_before_begin_m")
            hung.append((end, before, network.edge_lanes(before)[0].line.length - apart, theirs))
            hung.append((self.end_code, facing, there - apart, limit))
        others = (
            plate_beside(network, code, edge, s, number=number, role=DISTRACTOR, value=value)
            for number, (code, edge, s, value) in enumerate(hung, 1)
        )
        return target, *others

    def before(self, task: SceneTask, limit: float) -> float:
        """No faster than the other zone allows."""
        return min(super().before(task, limit), self.other(task, limit) * KMH)

    @staticmethod
    def across(task: SceneTask, edge: str, s: float) -> tuple[str, float]:
        """The edge of the other direction, and where along it a place of an edge is."""
        facing = task.row.fields["opposite"]
        line = task.network.edge_lanes(facing)[0].line
        there = line.project(*task.network.edge_lanes(edge)[0].line.point_at(s))[0]
        require(_ROOM_M <= there <= line.length - _ROOM_M, "the other direction ends before the zones")
        return facing, there


def task_minimum(task: SceneTask) -> float:
    """The number on a variant's plate, km/h: round those that the road allows, so that each is there as often."""
    recipe, shown = task.recipe, task.network.expected_speed(task.row.fields["edge"])
    road = min(task.row.speed_mps, shown) / KMH
    (code,), other = recipe.type.codes, recipe.choices["contrast_plates"][0]
    below = recipe.number("contrast_below_kmh")
    usable = [
        v
        for v in recipe.choices["limits_kmh"]
        if v + recipe.number("below_road_kmh") <= road + 0.5
        and can_post(recipe, task.row, code, v)
        and can_post(recipe, task.row, other, v - below)
    ]
    require(bool(usable), f"no minimum for a {task.row.road_class} road of {road:.0f} km/h")
    return float(usable[task.variant.value % len(usable)])


class MinSpeedPlacement(ScenePlacement):
    """`min_speed`: 4.6 soon after the start.

    In the contrast half the plate there allows no more than the speed of the slow style, the blind baseline. No other
    vehicle drives on the road: none could keep both halves' plates.
    """

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The road stays as it is."""
        del recipe
        require(not row.oneway, "no other direction, where the other half's plate faces")
        return plain

    def place(self, task: SceneTask) -> Arrangement:
        """The ego 30 m before the plate, 12 to 18 km/h too slow."""
        row, network, recipe, variant = task.row, task.network, task.recipe, task.variant
        minimum = task_minimum(task)
        edge = row.fields["edge"]
        lanes = passenger_lanes(network, edge)
        require(len(lanes) >= recipe.number("least_lanes"), f"{len(lanes)} lanes for cars")
        lane = lanes[variant.layout % len(lanes)]
        # The slower a variant starts, the farther it is below the minimum.
        deficit = np.interp(
            variant.initial_speed,
            INITIAL_SPEEDS_MPS,
            (recipe.number("most_deficit_kmh"), recipe.number("least_deficit_kmh")),
        )
        end_s = lane.line.length - recipe.number("end_before_edge_m")
        latest = end_s - recipe.number("zone_m") - recipe.number("plate_after_start_m")
        front = EGO_LENGTH_M + recipe.number("start_after_edge_m")
        require(latest >= front, f"the corridor is {lane.line.length:.0f} m long")
        front += float(task.rng.uniform(0.0, min(latest - front, recipe.number("jitter_m"))))
        plate_s = front + recipe.number("plate_after_start_m")
        # No farther than the slow style gets within the horizon.
        end_s = plate_s + variant.route_end(recipe.number("zone_m"), end_s - plate_s)
        start = EgoStart(lane.id, front - EGO_LENGTH_M / 2, (minimum - float(deficit)) * KMH)
        sign = plate_beside(network, self.code, edge, plate_s, ZoneParams((edge,)), value=minimum)
        return Arrangement(
            signs=(sign,),
            targets=(sign.id,),
            start=start,
            destination=Destination(edge, end_s),
            route_hint=(edge,),
            route_length=end_s - plate_s,
            closed_edges=frozenset(network.edges),
        )

    def contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement:
        """3.24 on the same post: the minimum less 10 km/h and more is the most that is allowed."""
        (sign,) = signed.signs
        recipe = task.recipe
        value = sign.posted - recipe.number("contrast_below_kmh")
        other = replace(sign, code=recipe.choices["contrast_plates"][0], value=value)
        return replace(signed, signs=(other,))
