"""A one-way exit whose leftmost lane others use against the ego's direction. Source: docs/scenes.md. Units: m.

The network is rebuilt: that lane is an edge of its own, the other way round, from the road's end to the junction.
"""

from __future__ import annotations

import math
from dataclasses import replace

from tsbench.geometry.angles import wrap_deg
from tsbench.geometry.polyline import Array, Polyline
from tsbench.make.maps.plain import PlainConnection, PlainEdge, PlainNet, Point
from tsbench.make.placements.lane_users import lane_users
from tsbench.make.placements.placement import (
    Arrangement,
    ScenePlacement,
    SceneTask,
    UnfitMapError,
    keep_clear,
    passenger_lanes,
    plate_beside,
    require,
    start_speed,
)
from tsbench.make.scenes.recipe import Recipe
from tsbench.make.seeds import seed_of
from tsbench.roads.lane_graph import Destination
from tsbench.roads.network import DEFAULT_LANE_WIDTH_M, RoadNetwork
from tsbench.roads.reserved_lanes import contraflow_lanes
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.plate_params import ReservedLaneParams
from tsbench.sim.scene import EgoStart
from tsbench.sim.world import EGO_LENGTH_M


class ContraflowPlacement(ScenePlacement):
    """`bus_lane_road`, `bike_lane_road`: users come towards an ego that drives straight on in its lane."""

    def __init__(self, recipe: Recipe) -> None:
        self.code = recipe.type.codes[0]
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
        turned = contraflow_lanes(network, "passenger").get(network.edge_lanes(reserved)[0].index)
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
            target=sign.id,
            start=start,
            destination=Destination(exit_, end_s),
            route_hint=(approach, exit_),
            route_length=end_s,
            convoy=lane_users(task, self.users, contra, (reserved, onward), lane, start, across),
            blocked=keep_clear(passenger_lanes(network, approach)[-1:], start),
        )


_CONTRA = ".contra"


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
