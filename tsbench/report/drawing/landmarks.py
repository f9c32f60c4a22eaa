"""Where the things of a scene are: the destination's ground, a plate's line and side, the ways. Units: m, rad."""

from __future__ import annotations

import math

import numpy as np
import shapely

from tsbench.episode.outcome import ARRIVAL_M
from tsbench.geometry.overlap import strip
from tsbench.geometry.polyline import Array
from tsbench.roads.lane_graph import LaneGraph
from tsbench.roads.network import RoadNetwork
from tsbench.signs.annotations import SignInstance
from tsbench.sim.scene import Scene


def destination_place(scene: Scene) -> tuple[shapely.Geometry, tuple[float, float]]:
    """The stretch of road in which the ego has arrived, and its middle."""
    s = scene.destination.s
    lanes = scene.network.edge_lanes(scene.destination.edge)
    areas, middles = [], []
    for lane in [lane for lane in lanes if lane.permits("passenger")] or lanes:
        middles.append(lane.line.point_at(s))
        a, b = max(s - ARRIVAL_M, 0.0), min(s + ARRIVAL_M, lane.line.length)
        if b - a >= 0.1:
            areas.append(strip(lane.line.slice(a, b), lane.width))
    x, y = np.mean(middles, axis=0).tolist()
    return shapely.union_all(areas), (x, y)


def plate_line(network: RoadNetwork, sign: SignInstance) -> Array:
    """The cross-section of the road at which a plate begins to bind, (2, 2)."""
    lanes = network.edge_lanes(sign.edge)
    right, left = lanes[0], lanes[-1]
    at = min(sign.position_m, right.line.length)
    return np.array([right.line.point_at(at, -right.width / 2), left.line.point_at(at, left.width / 2)])


def way_off(network: RoadNetwork, sign: SignInstance) -> tuple[Array, float]:
    """Unit vector in the picture that leads from a post off the road, and how far the kerb is, m (0 beside it)."""
    # To the right of the traffic that the plate faces; pixel rows grow downwards.
    right = np.array([math.sin(sign.heading), math.cos(sign.heading)])
    lanes = network.edge_lanes(sign.edge)
    to_right = lanes[0].line.project(sign.x, sign.y)[1] + lanes[0].width / 2
    to_left = lanes[-1].width / 2 - lanes[-1].line.project(sign.x, sign.y)[1]
    if min(to_right, to_left) <= 0.0:
        return (right if to_right <= 0.0 else -right), 0.0
    edge = network.edges[sign.edge]
    two_way = any((e.source, e.target) == (edge.target, edge.source) for e in network.edges.values())
    # A post on an island: to the nearer kerb, but never over the other direction's lanes.
    return (right, to_right) if two_way or to_right <= to_left else (-right, to_left)


def way_points(scene: Scene, graph: LaneGraph, edges: tuple[str, ...], d: float) -> Array:
    """A way over edges from the start to the destination, d to the left, (n, 2); empty where there is none."""
    start = scene.network.lane(scene.start.lane)
    path = graph.path(edges, start.index, scene.start.s, scene.destination) if edges else None
    if path is None:
        return np.zeros((0, 2))
    line = path.line.slice(0.0, path.destination_s) if path.destination_s > 1.0 else path.line
    return line.beside(d)
