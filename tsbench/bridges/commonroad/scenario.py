"""What a planner is told here, as a CommonRoad `Scenario`: lanelets, plates, stop lines, road users with forecasts.

Any planner that takes commonroad-io's objects can be asked with it. Road users are told where they will be in the next
seconds if they keep their speed and lane. Units: m, m/s, rad; one time step is 0.1 s.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import count, pairwise
from typing import Any

import commonroad_dc.pycrcc as collision
import numpy as np
import shapely
from commonroad.common.common_lanelet import LineMarking, StopLine
from commonroad.geometry.shape import Rectangle
from commonroad.prediction.prediction import TrajectoryPrediction
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType, StaticObstacle
from commonroad.scenario.scenario import Scenario, ScenarioID
from commonroad.scenario.state import CustomState, InitialState
from commonroad.scenario.traffic_sign import TrafficSign, TrafficSignElement, TrafficSignIDZamunda
from commonroad.scenario.trajectory import Trajectory

from tsbench.bridges.commonroad_lanelets import SIGN_NUMBERS
from tsbench.geometry.elementary import wrap
from tsbench.geometry.polyline import Array, Polyline
from tsbench.planners.base import PlannerContext
from tsbench.planners.geometry import lane_polygon
from tsbench.planners.helpers import identified
from tsbench.planners.observation import Observation, SignView
from tsbench.roads.road_map import MapLane, RoadMap
from tsbench.signs.catalog import Catalog, load_catalog
from tsbench.sim.world import ActorKind

# CommonRoad's made-up country, whose numbers of signs are modelled on Germany's.
COUNTRY = "ZAM"
_SHORTEST_M = 0.05
# Slivers between a junction's paths, where its area and theirs do not quite meet.
_SLIVER_M = 0.3
_WALL_M = 0.02
_STOPS = {"2.4": LineMarking.BROAD_DASHED, "2.5": LineMarking.BROAD_SOLID}
_KINDS = {
    ActorKind.CAR: ObstacleType.CAR,
    ActorKind.BUS: ObstacleType.BUS,
    ActorKind.BICYCLE: ObstacleType.BICYCLE,
    ActorKind.PEDESTRIAN: ObstacleType.PEDESTRIAN,
}
_NUMBERS = {number.value: number for number in TrafficSignIDZamunda}
_MPS_PER_KMH = 1 / 3.6


class LiveScenario:
    """One episode's roads with the plates seen so far, and its road users as of now."""

    def __init__(self, context: PlannerContext) -> None:
        self.roads = context.network
        self.dt = context.dt
        self._plates: dict[tuple[Any, ...], SignView] = {}
        self._network: Any = None
        self._lanelets: dict[int, tuple[tuple[float, int], ...]] = {}

    def network(self, observation: Observation) -> Any:
        """The `LaneletNetwork`; the same object until a plate comes into sight."""
        fresh = False
        for sign in map(identified, observation.signs):
            place = (sign.code, sign.value, sign.edge, sign.lane, sign.position_m)
            # A masked plate, or an outline that many have, is nothing that CommonRoad could be told.
            if sign.code and sign.edge in self.roads.edges and place not in self._plates:
                self._plates[place] = sign
                fresh = True
        if fresh or self._network is None:
            self._network, self._lanelets = _network(self.roads, list(self._plates.values()))
        return self._network

    def lanelet_at(self, lane: int, s: float) -> int | None:
        """Id of the lanelet on which arc length `s` of a lane (index) is; None: it is too short to be one."""
        found = None
        for begins, lanelet in self._lanelets.get(lane, ()):
            if found is None or begins <= s:
                found = lanelet
        return found

    def scenario(self, observation: Observation, steps: int) -> Any:
        """The `Scenario`, road users with their ways in the next `steps` time steps."""
        made = Scenario(self.dt, ScenarioID.from_benchmark_id(f"{COUNTRY}_Tsbench-1_1_T-1", "2020a"))
        made.add_objects(self.network(observation))
        roads = made.lanelet_network
        ids = (*(one.lanelet_id for one in roads.lanelets), *(one.traffic_sign_id for one in roads.traffic_signs))
        free = count(1 + max(ids))
        made.add_objects([*_fixed(observation, free), *self._moving(observation, steps, free)])
        return made

    def _moving(self, o: Observation, steps: int, free: Iterator[int]) -> list[Any]:
        actors, found = o.actors, []
        for k in range(len(actors)):
            x, y, heading = actors.pose[k].tolist()
            way = forecast(self.roads, int(actors.lane[k]), (x, y, heading), float(actors.speed[k]) * self.dt, steps)
            shape = Rectangle(float(actors.length[k]), float(actors.width[k]))
            speed = float(actors.speed[k])
            first = state_of(x, y, heading, speed)
            states = [
                CustomState(
                    time_step=step,
                    position=pose[:2],
                    orientation=math.remainder(float(pose[2]), math.tau),
                    velocity=speed,
                )
                for step, pose in enumerate(way, start=1)
            ]
            ahead = TrajectoryPrediction(Trajectory(1, states), shape)
            kind = _KINDS[ActorKind(int(actors.kind[k]))]
            found.append(DynamicObstacle(next(free), kind, shape, first, ahead))
        return found


def forecast(roads: RoadMap, lane: int, pose: tuple[float, float, float], step: float, steps: int) -> Array:
    """(steps, 3) poses every `step` metres: along the lane and the way on that bends least, or straight on.

    A vehicle off the lanes, or driving against or across its lane, goes straight on.
    """
    x, y, heading = pose
    ways = step * np.arange(1, steps + 1)
    line = roads.lanes[lane].line if lane >= 0 else None
    if line is not None:
        s, d = line.project(x, y)
        if abs(wrap(line.heading_at(s) - heading)) < math.pi / 4:
            line = _ahead(roads, lane, s + float(ways[-1]))
            return np.array([(*line.point_at(s + way, d), line.heading_at(s + way)) for way in ways.tolist()])
    straight = np.array([math.cos(heading), math.sin(heading)])
    return np.column_stack((np.array([x, y]) + ways[:, None] * straight, np.full(steps, heading)))


def _ahead(roads: RoadMap, lane: int, reach: float) -> Polyline:
    """The lane's line, continued by what leads on straightest until it is `reach` m long or ends."""
    parts, seen = [roads.lanes[lane].line.points], {lane}
    length = roads.lanes[lane].line.length
    while length < reach:
        here = roads.lanes[lane].line.heading_at(roads.lanes[lane].line.length)
        ways = (pairwise((c.from_lane, *c.via, c.to_lane)) for c in roads.connections)
        onward = sorted({b for way in ways for a, b in way if a == lane} - seen)
        if not onward:
            break
        lane = min(onward, key=lambda k: abs(wrap(roads.lanes[k].line.heading_at(roads.lanes[k].line.length) - here)))
        seen.add(lane)
        parts.append(roads.lanes[lane].line.points[1:])
        length += roads.lanes[lane].line.length
    return Polyline(np.concatenate(parts))


def walls(roads: RoadMap) -> Any:
    """The edge of all that one may drive on, as a collision object of commonroad-drivability-checker.

    Its own `create_road_boundary_obstacle` knows lanelets alone, and walls off what lies between them in a junction.
    """
    areas = [shapely.Polygon(lane_polygon(lane)).buffer(0.0) for lane in roads.lanes if _is_one(lane)]
    areas += [
        shapely.Polygon(junction.polygon).buffer(0.0)
        for junction in roads.junctions.values()
        if len(junction.polygon) > 2
    ]
    road = shapely.union_all(areas).buffer(_SLIVER_M, join_style="mitre").buffer(-_SLIVER_M, join_style="mitre")
    group = collision.ShapeGroup()
    for polygon in shapely.get_parts(road):
        for ring in (polygon.exterior, *polygon.interiors):
            for (ax, ay), (bx, by) in pairwise(ring.coords):
                half = math.hypot(bx - ax, by - ay) / 2
                group.add_shape(
                    collision.RectOBB(half, _WALL_M, math.atan2(by - ay, bx - ax), (ax + bx) / 2, (ay + by) / 2)
                )
    return group


def _is_one(lane: MapLane) -> bool:
    return lane.line.length >= _SHORTEST_M


def state_of(x: float, y: float, heading: float, speed: float, acceleration: float = 0.0, yaw_rate: float = 0.0) -> Any:
    """How something moves at the start."""
    place = {"position": np.array([x, y]), "orientation": heading, "velocity": speed}
    return InitialState(time_step=0, slip_angle=0.0, acceleration=acceleration, yaw_rate=yaw_rate, **place)


def _fixed(o: Observation, free: Iterator[int]) -> list[Any]:
    found = []
    for one in o.obstacles:
        kind = ObstacleType.CONSTRUCTION_ZONE if one.shape == "cones" else ObstacleType.ROAD_BOUNDARY
        shape, state = Rectangle(one.length, one.width), state_of(one.x, one.y, one.heading, 0.0)
        found.append(StaticObstacle(next(free), kind, shape, state))
    return found


def _network(roads: RoadMap, plates: list[SignView]) -> tuple[Any, dict[int, tuple[tuple[float, int], ...]]]:
    """The network, and by lane where its lanelets begin, and their ids.

    CommonRoad's plates hold for whole lanelets, so a lane is cut where a plate's line is. A plate holds from there to
    its end plate on the same road, or to the end of that.
    """
    free, catalog = count(1), load_catalog(mirrored=roads.left_hand)
    lanes = [lane for lane in roads.lanes if _is_one(lane)]
    lanelets: dict[int, tuple[tuple[float, int], ...]] = {}
    for lane in lanes:
        marks = {sign.position_m for sign in plates if _is_on(roads, sign, lane)}
        inner = sorted(mark for mark in marks if _SHORTEST_M < mark < lane.line.length - _SHORTEST_M)
        lanelets[lane.index] = tuple((begins, next(free)) for begins in (0.0, *inner))
    sign_ids = [next(free) for _ in plates]
    holds: list[set[int]] = [set() for _ in plates]
    after, before = _neighbours(roads, lanelets)
    network = LaneletNetwork()
    for lane in lanes:
        parts = lanelets[lane.index]
        ends = [*(begins for begins, _ in parts[1:]), lane.line.length]
        beside = {
            f"adjacent_{side}": lanelets[other][0][1]
            for side, other in (("left", lane.left), ("right", lane.right))
            if other in lanelets and len(lanelets[other]) == len(parts) == 1
        }
        same = {f"{side}_same_direction": True for side in beside}
        for (begins, lanelet_id), end in zip(parts, ends, strict=True):
            piece = lane.line if len(parts) == 1 else lane.line.slice(begins, end)
            left, right = (piece.beside(d) for d in (lane.width / 2, -lane.width / 2))
            line = _stop_line(roads, lane, plates, sign_ids) if end == lane.line.length else None
            lines = (left, np.array(piece.points), right)
            ways = (lanelet_id, before[lanelet_id], after[lanelet_id])
            network.add_lanelet(Lanelet(*lines, *ways, **beside, **same, stop_line=line))
            for sign, held in zip(plates, holds, strict=True):
                begun = _is_on(roads, sign, lane) and sign.position_m <= begins + _SHORTEST_M
                if begun and not any(_is_on(roads, end, lane) and _ends(catalog, end, sign, begins) for end in plates):
                    held.add(lanelet_id)
    for sign, sign_id, held in zip(plates, sign_ids, holds, strict=True):
        network.add_traffic_sign(_sign(sign, sign_id, held), held)
    return network, lanelets


def _ends(catalog: Catalog, end: SignView, sign: SignView, by: float) -> bool:
    """Is a plate's zone over `by` m along its road, because of another plate on it?"""
    ended_by = catalog.sign(sign.code).rule.ended_by if sign.code else ()
    return end.code in ended_by and sign.position_m < end.position_m <= by + _SHORTEST_M


def _is_on(roads: RoadMap, sign: SignView, lane: MapLane) -> bool:
    return sign.edge == lane.edge and (sign.lane < 0 or roads.edges[sign.edge].lanes[sign.lane] == lane.index)


def _neighbours(
    roads: RoadMap, lanelets: dict[int, tuple[tuple[float, int], ...]]
) -> tuple[dict[int, list[int]], dict[int, list[int]]]:
    """Successors and predecessors by lanelet id."""
    steps = {(a[1], b[1]) for parts in lanelets.values() for a, b in pairwise(parts)}
    for c in roads.connections:
        chain = [lane for lane in (c.from_lane, *c.via, c.to_lane) if lane in lanelets]
        steps |= {(lanelets[a][-1][1], lanelets[b][0][1]) for a, b in pairwise(chain)}
    ids = [lanelet for parts in lanelets.values() for _, lanelet in parts]
    after: dict[int, list[int]] = {lanelet: [] for lanelet in ids}
    before: dict[int, list[int]] = {lanelet: [] for lanelet in ids}
    for a, b in sorted(steps):
        after[a].append(b)
        before[b].append(a)
    return after, before


def _stop_line(roads: RoadMap, lane: MapLane, plates: list[SignView], sign_ids: list[int]) -> Any:
    """Across the lane's end, where a plate asks for one."""
    asking = [
        (sign, sign_id)
        for sign, sign_id in zip(plates, sign_ids, strict=True)
        if sign.code in _STOPS and _is_on(roads, sign, lane)
    ]
    if not asking:
        return None
    ends = (np.array(lane.line.point_at(lane.line.length, d)) for d in (lane.width / 2, -lane.width / 2))
    return StopLine(*ends, _STOPS[asking[0][0].code], {sign_id for _, sign_id in asking})


def _sign(sign: SignView, sign_id: int, first: set[int]) -> Any:
    """A plate; one that CommonRoad has no number for is UNKNOWN."""
    number = _NUMBERS.get(SIGN_NUMBERS.get(sign.code, ""), TrafficSignIDZamunda.UNKNOWN)
    values = [] if sign.value is None else [f"{sign.value * _MPS_PER_KMH:.4f}"]
    return TrafficSign(sign_id, [TrafficSignElement(number, values)], first, np.array([sign.x, sign.y]), virtual=False)
