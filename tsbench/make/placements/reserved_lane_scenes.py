"""Lanes for buses or cyclists: in the ego's own direction where the ego drives, or against it in a one-way exit.

For the second the network is rebuilt: that lane is an edge of its own, the other way round, from the road's end to the
junction. Source: docs/scenes.md, "Reserved lanes". Units: m.
"""

from __future__ import annotations

import math
from dataclasses import replace

from lxml import etree

from tsbench.geometry.elementary import wrap_deg
from tsbench.geometry.polyline import Array, Polyline
from tsbench.make.maps.plain import PlainConnection, PlainEdge, PlainLane, PlainNet, Point, split_edge
from tsbench.make.placements.placement import (
    Arrangement,
    ScenePlacement,
    SceneTask,
    UnfitMapError,
    exchanged,
    keep_clear,
    lane_users,
    passenger_lanes,
    plate_beside,
    require,
    start_speed,
    user_driver,
    usual_limit,
)
from tsbench.make.scenes.recipe import Recipe
from tsbench.make.scenes.traffic import moving_vehicle
from tsbench.make.seeds import seed_of
from tsbench.roads.lane_graph import Destination
from tsbench.roads.network import DEFAULT_LANE_WIDTH_M, Lane, RoadNetwork
from tsbench.roads.reserved_lanes import contraflow_lanes
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.contrast import ContrastClause, WayParams
from tsbench.signs.rule_kinds import ReservedLaneParams
from tsbench.sim.scene import EgoStart
from tsbench.sim.world import EGO_LENGTH_M

_CONTRA = ".contra"


class ReservedLanePlacement(ScenePlacement):
    """`bus_lane`, `bike_lane`: from the plate on the rightmost lane is for others, to the end of the marked zone.

    A second post stands on the other side of the road and faces oncoming traffic, whose rightmost lane it may reserve.
    The halves exchange the two posts' plates, a reserved lane and a usual limit. Users drive on the oncoming lane
    alone, and no other vehicle drives on either lane: which one is theirs, only the plates say.
    """

    def __init__(self, recipe: Recipe) -> None:
        super().__init__(recipe)
        self.users = recipe.catalog.sign(self.code).rule.option("users")

    def _zone(self, row: PoolRow, recipe: Recipe) -> tuple[float, float]:
        """Arc lengths on the corridor of the plate and of the zone's end."""
        length, after = row.length_m, recipe.number("after_zone_m")
        plate = min(
            recipe.number("start_room_m") + EGO_LENGTH_M + recipe.number("run_up_most_m"),
            length - after - recipe.number("zone_least_m"),
        )
        return plate, min(plate + recipe.number("zone_most_m"), length - after)

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """Both directions in three parts; in the middle ones no car of others uses the rightmost lane."""
        require(row.lanes >= recipe.number("least_lanes"), f"{row.lanes} lanes")
        motorway = row.road_class.startswith("motorway")
        require(not (motorway and self.users == "bicycle"), "no bicycles on a motorway")
        other = next((e for e in plain.edges if e.id == row.fields.get("opposite")), None)
        if other is None:
            raise UnfitMapError("no other direction, where the other half's plate faces")
        require(other.num_lanes >= recipe.number("least_lanes"), f"{other.num_lanes} oncoming lanes")
        plate, end = self._zone(row, recipe)
        run_up_room(plate, recipe)
        road = Polyline(next(e.shape for e in plain.edges if e.id == row.fields["edge"]))
        beside = plate - recipe.number("facing_before_plate_m")
        ends = beside, max(beside - recipe.number("zone_most_m"), recipe.number("least_destination_m"))
        line = Polyline(other.shape)
        net, (_, zone, _) = split_edge(plain, row.fields["edge"], (plate, end))
        cuts = [line.project(*road.point_at(s))[0] for s in ends]
        require(0.0 < cuts[0] < cuts[1] < line.length, "the two directions do not run side by side")
        net, (_, facing, _) = split_edge(net, other.id, cuts)
        lanes = (PlainLane(0, allow=self.users),)
        edges = (replace(e, lanes=lanes) if e.id in (zone, facing) else e for e in net.edges)
        return replace(net, edges=tuple(edges))

    def place(self, task: SceneTask) -> Arrangement:
        """The ego 60 to 100 m before the plate in the lane that it reserves; users come towards it."""
        row, network, recipe, variant = task.row, task.network, task.recipe, task.variant
        first, zone, last = (f"{row.fields['edge']}.{k}" for k in range(3))
        facing, beyond = (f"{row.fields['opposite']}.{k}" for k in (1, 2))
        lane, reserved = network.edge_lanes(first)[0], network.edge_lanes(zone)[0]
        start = start_before_plate(task, lane.id, lane.line.length)
        sign = plate_beside(network, self.code, zone, 0.0, ReservedLaneParams((zone,), first, (reserved.id,)), lane=0)
        other = usual_limit(task, recipe.choices["harmless"][0], (facing, 0.0), (facing, zone))
        room = network.edge_lanes(last)[0].line.length - recipe.number("end_before_edge_m")
        end_s = variant.route_end(recipe.number("least_destination_m"), room)
        return Arrangement(
            signs=(sign, other),
            targets=(sign.id,),
            start=start,
            destination=Destination(last, end_s),
            route_hint=(first, zone, last),
            route_length=reserved.line.length + end_s,
            extra=_users(task, self.users, network.edge_lanes(facing)[0], (facing, beyond)),
            blocked=((lane.id, start.s, lane.line.length),),
        )

    def contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement:
        """The two plates exchanged: the oncoming lane is reserved, and the ego stays in its own."""
        del task
        plate, other = signed.signs
        params = plate.params_as(ReservedLaneParams)
        stay = ContrastClause("needless_detour", WayParams(params.approach, lanes=params.lanes))
        return replace(signed, targets=(other.id,), signs=exchanged(plate, other), contrast=(stay,))


def _users(task: SceneTask, vclass: str, lane: Lane, edges: tuple[str, ...]) -> tuple[etree._Element, ...]:
    """Buses or cyclists on the oncoming lane, a headway from each other, the last near its beginning."""
    driver, counts = user_driver(task.recipe), task.recipe.choices["users"]
    asked = int(counts[task.variant.layout % len(counts)])
    first = driver.length + float(task.rng.uniform(0.0, task.recipe.number("user_jitter_m")))
    step = max(driver.speed * task.recipe.number("user_headway_s"), driver.length + driver.gap)
    places = [first + k * step for k in range(asked)]
    elements: list[etree._Element] = []
    for k, s in enumerate(p for p in places if p < lane.line.length - 1.0):
        place = s * lane.length / lane.line.length
        elements += moving_vehicle(f"user_{k}", driver, vclass, lane.order, place, edges)
    return tuple(elements)


def run_up_room(plate: float, recipe: Recipe) -> float:
    """How far before the plate (arc length on the corridor) the ego's front can start at most. Raises UnfitMapError."""
    room = plate - recipe.number("start_room_m") - EGO_LENGTH_M
    require(room >= recipe.number("run_up_least_m"), f"{plate:.0f} m of road before the plate")
    return min(room, recipe.number("run_up_most_m"))


def start_before_plate(task: SceneTask, lane: str, plate: float) -> EgoStart:
    """The ego with its front so far before the end of its lane as drawn."""
    recipe = task.recipe
    # Corridors are cut to centimetres: the lane may be a little shorter than planned.
    most = min(run_up_room(plate + 1.0, recipe), plate - EGO_LENGTH_M - 0.1)
    before = float(task.rng.uniform(recipe.number("run_up_least_m"), most))
    speed = start_speed(task, task.network.lane(lane))
    return EgoStart(lane, plate - before - EGO_LENGTH_M / 2, speed)


class ContraflowPlacement(ScenePlacement):
    """`bus_lane_road`, `bike_lane_road`: users come towards an ego that drives straight on in its lane."""

    def __init__(self, recipe: Recipe) -> None:
        super().__init__(recipe)
        self.users = recipe.catalog.sign(self.code).rule.option("users")

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The exit's leftmost lane turned round, and the approach's lanes leading straight on into the others."""
        approach, exit_ = _way(row, plain, recipe)
        lanes = next(e.num_lanes for e in plain.edges if e.id == exit_)
        straight = tuple(PlainConnection(approach, exit_, k, k) for k in range(lanes - 1))
        net = turn_leftmost(plain, exit_, contra_id(exit_), self.users)
        return replace(net, connections=(*net.connections, *straight))

    def place(self, task: SceneTask) -> Arrangement:
        """The ego 60 to 100 m before the line in the leftmost lane; users come towards it from the road's end."""
        network, graph, recipe, variant = task.network, task.graph, task.recipe, task.variant
        reserved = next((e for e in network.edges if e.endswith(_CONTRA)), "")
        turned = contraflow_lanes(network).get(network.edge_lanes(reserved)[0].index)
        if turned is None:
            raise UnfitMapError("the turned lane does not lie straight ahead of a lane")
        lane, exit_, contra = network.lanes[turned.entry], turned.host, network.lanes[turned.lane]
        approach = lane.edge
        require(graph.route(approach, exit_) == (approach, exit_), "the exit is not the next edge of the route")
        onward = _onward(network, reserved)
        params = ReservedLaneParams((exit_,), approach, (contra.id,))
        sign = plate_beside(network, self.code, exit_, recipe.number("plate_after_junction_m"), params)
        most = min(recipe.number("run_up_most_m"), lane.line.length - EGO_LENGTH_M - 0.1)
        least = recipe.number("run_up_least_m")
        require(most >= least, f"{lane.line.length:.0f} m of road before the junction")
        before = float(task.rng.uniform(least, most))
        start = EgoStart(lane.id, lane.line.length - before - EGO_LENGTH_M / 2, start_speed(task, lane))
        room = network.edge_lanes(exit_)[0].line.length - recipe.number("end_before_edge_m")
        end_s = variant.route_end(0.0, room)
        across = math.dist(lane.line.points[-1], contra.line.points[-1])
        return Arrangement(
            signs=(sign,),
            targets=(sign.id,),
            start=start,
            destination=Destination(exit_, end_s),
            route_hint=(approach, exit_),
            route_length=end_s,
            convoy=lane_users(task, self.users, contra, (reserved, onward), lane, start, across),
            blocked=keep_clear(passenger_lanes(network, approach)[-1:], start),
        )


def contra_id(edge: str) -> str:
    """Id of the contraflow lane's edge."""
    return f"{edge}{_CONTRA}"


def _way(row: PoolRow, plain: PlainNet, recipe: Recipe) -> tuple[str, str]:
    """An approach and the one-way exit straight ahead of it, of as many lanes, drawn by map. Raises UnfitMapError."""
    lanes = {e.id: e.num_lanes for e in plain.edges}
    arms = row.fields["arms"]
    found = [
        (a["in_edge"], b["out_edge"])
        for a in arms
        for b in arms
        if a["in_edge"] in lanes
        and b["out_edge"] in lanes
        and not b["in_edge"]
        and recipe.number("least_lanes") <= lanes[a["in_edge"]] == lanes[b["out_edge"]]
        and a["length_m"] >= recipe.number("run_up_least_m") + EGO_LENGTH_M
        and b["length_m"] >= recipe.number("zone_least_m")
        and 180.0 - abs(wrap_deg(b["heading_deg"] - a["heading_deg"])) <= recipe.number("straight_deg")
    ]
    require(bool(found), "no one-way exit lies straight ahead of an approach with as many lanes")
    return min(found, key=lambda way: (seed_of("contraflow", row.map_id, *way), way))


def _onward(network: RoadNetwork, reserved: str) -> str:
    """The edge by which users of the contraflow lane leave the junction. Raises UnfitMapError."""
    targets = [c.to_lane for c in network.outgoing[network.edge_lanes(reserved)[0].index]]
    edges = sorted({network.lanes[i].edge for i in targets})
    require(bool(edges), "the contraflow lane's users have no way on")
    return max(edges, key=lambda e: (network.edges[e].length, e))


def turn_leftmost(plain: PlainNet, edge_id: str, contra: str, users: str) -> PlainNet:
    """The net with an edge's leftmost lane as an edge of its own, turned round, for `users` (SUMO vClass) only."""
    edge = next(e for e in plain.edges if e.id == edge_id)
    width = edge.width or DEFAULT_LANE_WIDTH_M
    line = Polyline(edge.shape)
    left = edge.num_lanes * width / 2 if edge.spread == "center" else 0.0
    # Both edges lie to the right of the line between them, each in its own direction.
    between = _points(line.beside(left - width))
    rest = replace(edge, num_lanes=edge.num_lanes - 1, shape=between, spread="right")
    turned = PlainEdge(
        id=contra, source=edge.target, target=edge.source, num_lanes=1, speed=edge.speed, priority=edge.priority,
        shape=between[::-1], type=edge.type, name=edge.name, width=edge.width, allow=users,
    )  # fmt: skip
    last = edge.num_lanes - 1
    links = tuple(
        c
        for c in plain.connections
        if (c.target, c.to_lane) != (edge_id, last) and (c.source, c.from_lane) != (edge_id, last)
    )
    edges = (*(rest if e.id == edge_id else e for e in plain.edges), turned)
    return replace(plain, edges=edges, connections=links)


def _points(array: Array) -> tuple[Point, ...]:
    return tuple((float(x), float(y)) for x, y in array)
