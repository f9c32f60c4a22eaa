"""Corridor scenes: a speed zone, and an obstacle to pass. Source: spec/scenes.md, "Speed" and "Detour"."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from tsbench.geometry.polyline import Polyline
from tsbench.maps.network import RoadNetwork
from tsbench.maps.plain import PlainConnection, PlainEdge, PlainNet, PlainNode
from tsbench.maps.pool import PoolRow
from tsbench.scenarios.elements import obey_element
from tsbench.scenarios.families.base import Arrangement, SceneTask, beside_road, passenger_lanes, require
from tsbench.scenarios.recipe import Recipe
from tsbench.scenarios.seeds import seed_of
from tsbench.signs.annotations import SignInstance
from tsbench.sim.scene import Destination, EgoStart, Obstacle
from tsbench.sim.world import EGO_LENGTH_M

KMH = 1.0 / 3.6


def split_edge(plain: PlainNet, edge_id: str, cuts: Sequence[float]) -> tuple[PlainNet, tuple[str, ...]]:
    """Cut an edge at arc lengths (m), lane for lane; returns the net and the parts' ids `<edge>.0`, `.1`, ..."""
    edge = next(e for e in plain.edges if e.id == edge_id)
    line = Polyline(edge.shape)
    ends = [0.0, *cuts, line.length]
    parts, nodes, links = [], [], []
    for k, (a, b) in enumerate(pairwise(ends)):
        shape = tuple((float(x), float(y)) for x, y in line.slice(a, b).points)
        source = edge.source if k == 0 else f"{edge_id}.cut{k}"
        target = edge.target if b == line.length else f"{edge_id}.cut{k + 1}"
        parts.append(replace(edge, id=f"{edge_id}.{k}", source=source, target=target, shape=shape))
        if k:
            x, y = line.point_at(a)
            nodes.append(PlainNode(f"{edge_id}.cut{k}", x, y))
            links += [
                PlainConnection(f"{edge_id}.{k - 1}", f"{edge_id}.{k}", i, i) for i in range(edge.num_lanes)
            ]
    edges: list[PlainEdge] = [e for e in plain.edges if e.id != edge_id] + parts
    connections = [c for c in plain.connections if edge_id not in (c.source, c.target)]
    net = replace(plain, nodes=(*plain.nodes, *nodes), edges=tuple(edges), connections=(*connections, *links))
    return net, tuple(p.id for p in parts)


def posted_limit(row: PoolRow, scenario_type: str, choices: Sequence[int], margin_kmh: float) -> int:
    """One of the values that the road allows, in equal shares by a stable hash of the map."""
    usable = [v for v in choices if v + margin_kmh <= row.speed_mps * 3.6 + 0.5]
    require(bool(usable), f"the road's own limit is {row.speed_mps * 3.6:.0f} km/h")
    return usable[seed_of("limit", scenario_type, row.map_id) % len(usable)]


class SpeedZonePlacement:
    """`speed_limit`: 3.24 ahead of a driver who is too fast for it, 3.25 shortly before the destination."""

    def __init__(self, recipe: Recipe) -> None:
        self.code = recipe.type.codes[0]

    def _zone(self, row: PoolRow, recipe: Recipe) -> tuple[float, float]:
        """Arc lengths of plate and end plate on the corridor."""
        length = row.length_m
        end = length - recipe.number("end_before_edge_m") - recipe.number("end_plate_before_destination_m")
        plate = min(end - recipe.number("zone_m"), recipe.number("plate_at_most_m"))
        require(plate >= recipe.number("plate_at_least_m"), f"the corridor is {length:.0f} m long")
        return plate, end

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The corridor in three parts, so that other traffic can be bound in the middle one."""
        posted_limit(row, recipe.type.id, recipe.choices["limits_kmh"], recipe.number("below_road_kmh"))
        return split_edge(plain, row.fields["edge"], self._zone(row, recipe))[0]

    def arrange(self, task: SceneTask) -> Arrangement:
        """The ego so far before the plate that 3.5 m/s2 after half a second suffices."""
        row, network, recipe, variant = task.row, task.network, task.recipe, task.variant
        limit = posted_limit(
            row, recipe.type.id, recipe.choices["limits_kmh"], recipe.number("below_road_kmh")
        )
        v = limit * KMH
        edge = row.fields["edge"]
        first, zone, last = (f"{edge}.{k}" for k in range(3))
        lanes = passenger_lanes(network, first)
        lane = lanes[variant.layout % len(lanes)]
        excess = max(recipe.number("least_excess_mps"), variant.initial_speed)
        v0 = min(v + excess, v + recipe.number("most_excess_kmh") * KMH, row.speed_mps)
        need = (v0 * v0 - v * v) / (2 * recipe.number("brake_mps2")) + 0.5 * v0 + 3.0
        room = lane.line.length - need - EGO_LENGTH_M
        require(room >= 0.0, f"no room to brake from {v0:.1f} m/s before the plate")
        jitter = float(task.rng.uniform(0.0, min(recipe.number("jitter_m"), room)))
        start = EgoStart(lane.id, lane.line.length - need - jitter - EGO_LENGTH_M / 2, v0)
        end_lane = network.edge_lanes(last)[0]
        end_s = recipe.number("end_plate_before_destination_m")
        require(end_s < end_lane.line.length - 3.0, "no room for the destination")
        signs = (
            self._plate(network, "sign_0", self.code, zone, float(limit), {"zone_edges": f"{zone} {last}"}),
            self._plate(network, "sign_1", "3.25", last, float(limit), {}),
        )
        share = float(task.rng.uniform(recipe.number("obey_least"), recipe.number("obey_most")))
        factors = [
            1.0 if k < share * len(task.drivers) else row.speed_mps / v for k in range(len(task.drivers))
        ]
        return Arrangement(
            signs=signs, target="sign_0", start=start, destination=Destination(last, end_s),
            route_hint=(first, zone, last), route_length=network.edges[zone].length + end_s,
            extra=(obey_element([zone], network, v),), speed_factors=tuple(factors),
        )  # fmt: skip

    @staticmethod
    def _plate(
        network: RoadNetwork, sign_id: str, code: str, edge: str, value: float, params: dict[str, str]
    ) -> SignInstance:
        x, y, heading = beside_road(network, edge, 0.0)
        role, ends = ("target", None) if params else ("end", "sign_0")
        return SignInstance(sign_id, code, value, edge, -1, 0.0, x, y, heading, role, ends, params)


class DetourPlacement:
    """`detour_right`: an obstacle on the leftmost lane, to be passed on its right."""

    def __init__(self, recipe: Recipe) -> None:
        self.code = recipe.type.codes[0]

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The road stays as it is: other traffic sees the obstacle itself."""
        require(row.lanes >= recipe.number("least_lanes"), f"{row.lanes} lanes")
        return plain

    def arrange(self, task: SceneTask) -> Arrangement:
        """The ego 60 m before the obstacle, in its lane."""
        row, network, recipe, variant = task.row, task.network, task.recipe, task.variant
        edge = row.fields["edge"]
        lanes = passenger_lanes(network, edge)
        require(len(lanes) >= recipe.number("least_lanes"), f"{len(lanes)} lanes for cars")
        lane = lanes[-1]
        shapes = recipe.choices["obstacles"]
        shape = shapes[variant.layout % len(shapes)]
        length, width = float(shape["length_m"]), float(shape["width_m"])
        ahead = recipe.number("ego_before_obstacle_m")
        length_m = lane.line.length
        latest = length_m - recipe.number("least_after_m") - length
        near = min(
            float(task.rng.uniform(0.0, recipe.number("jitter_m"))) + ahead + 1.5 * EGO_LENGTH_M, latest
        )
        start_s = near - ahead - EGO_LENGTH_M / 2
        require(start_s >= EGO_LENGTH_M / 2, f"the corridor is {length_m:.0f} m long")
        middle = near + length / 2
        x, y = lane.line.point_at(middle)
        heading = lane.line.heading_at(middle)
        obstacle = Obstacle("obstacle_0", str(shape["shape"]), x, y, heading, length, width, lane.id)
        px, py = lane.line.point_at(near)
        sign = SignInstance(
            id="sign_0", code=self.code, value=None, edge=edge, lane=lane.order, position_m=near, x=px, y=py,
            heading=lane.line.heading_at(near), role="target", params={"obstacle": obstacle.id},
        )  # fmt: skip
        end_s = min(middle + variant.route_length, length_m - recipe.number("end_before_edge_m"))
        return Arrangement(
            signs=(sign,), target=sign.id, start=EgoStart(lane.id, start_s, min(variant.initial_speed, lane.speed)),
            destination=Destination(edge, end_s), route_hint=(edge,), route_length=end_s - middle,
            obstacles=(obstacle,), blocked=((lane.id, start_s, middle),),
        )  # fmt: skip
