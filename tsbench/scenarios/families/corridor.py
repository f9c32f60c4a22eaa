"""Corridor scenes: a speed zone, and an obstacle to pass. Source: spec/scenes.md, "Speed" and "Detour"."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from tsbench.geometry.polyline import Polyline
from tsbench.maps.plain import PlainConnection, PlainEdge, PlainNet, PlainNode
from tsbench.maps.pool import PoolRow
from tsbench.scenarios.families.base import Arrangement, SceneTask, passenger_lanes, require
from tsbench.scenarios.recipe import Recipe
from tsbench.signs.annotations import SignInstance
from tsbench.sim.scene import Destination, EgoStart, Obstacle
from tsbench.sim.world import EGO_LENGTH_M


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
