"""A one-way road whose leftmost lane others use against the ego's direction. Source: docs/scenes.md. Units: m.

The network is rebuilt: from the plate on that lane is an edge of its own, the other way round.
"""

from __future__ import annotations

from dataclasses import replace

from tsbench.dataset.maps.plain import PlainEdge, PlainNet, Point
from tsbench.dataset.placements.corridor import split_edge
from tsbench.dataset.placements.lane_users import lane_users
from tsbench.dataset.placements.placement import Arrangement, ScenePlacement, SceneTask, plate_beside, require
from tsbench.dataset.placements.reserved_lane import run_up_room, start_before_plate
from tsbench.dataset.scenes.recipe import Recipe
from tsbench.geometry.polyline import Array, Polyline
from tsbench.roads.destination import Destination
from tsbench.roads.network import DEFAULT_LANE_WIDTH_M
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.catalog import load_catalog
from tsbench.signs.plate_params import ReservedLaneParams
from tsbench.sim.world import EGO_LENGTH_M


class ContraflowPlacement(ScenePlacement):
    """`bus_lane_road`, `bike_lane_road`: from the plate on, users come towards an ego that stays in its lane."""

    def __init__(self, recipe: Recipe) -> None:
        self.code = recipe.type.codes[0]
        self.users = load_catalog().sign(self.code).rule.option("users")

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The corridor cut at the plate, its leftmost lane turned round behind it."""
        require(row.oneway, "the road has two directions")
        require(row.lanes >= recipe.number("least_lanes"), f"{row.lanes} lanes")
        run_up = recipe.number("start_room_m") + EGO_LENGTH_M + recipe.number("run_up_most_m")
        plate = min(
            max(run_up, row.length_m - recipe.number("zone_most_m")),
            row.length_m - recipe.number("zone_least_m"),
        )
        run_up_room(plate, recipe)
        edge = row.fields["edge"]
        net, (_, zone) = split_edge(plain, edge, (plate,))
        return turn_leftmost(net, zone, contra_id(edge), self.users)

    def place(self, task: SceneTask) -> Arrangement:
        """The ego 60 to 100 m before the plate in the leftmost lane; users come towards it from the road's end."""
        row, network, recipe, variant = task.row, task.network, task.recipe, task.variant
        edge = row.fields["edge"]
        first, zone = f"{edge}.0", f"{edge}.1"
        lane, reserved = network.edge_lanes(first)[-1], network.edge_lanes(contra_id(edge))[0]
        start = start_before_plate(task, lane.id, lane.line.length)
        sign = plate_beside(network, self.code, zone, 0.0, ReservedLaneParams((zone,), first, (reserved.id,)))
        room = network.edge_lanes(zone)[0].line.length - recipe.number("end_before_edge_m")
        end_s = min(variant.route_length, room)
        return Arrangement(
            signs=(sign,), target=sign.id, start=start, destination=Destination(zone, end_s), route_hint=(first, zone),
            route_length=end_s,
            convoy=lane_users(task, self.users, reserved, (reserved.edge,), lane, start),
            blocked=((lane.id, start.s, lane.line.length),),
        )  # fmt: skip


def contra_id(edge: str) -> str:
    """Id of the contraflow lane's edge."""
    return f"{edge}.contra"


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
