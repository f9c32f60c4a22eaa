"""A corridor with two pedestrian crossings: how its network is made, and where their kerbs are. Units: m.

A crossing leads over both directions of the road. A footpath comes up to it from either side, square to the road, so
that lanes keep their numbers and every pedestrian on a footpath means to cross.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tsbench.geometry.polyline import Polyline, join
from tsbench.make.maps.plain import PlainCrossing, PlainEdge, PlainNet, PlainNode, split_edge
from tsbench.make.maps.plain_xml import DEFAULT_WIDTH_M
from tsbench.make.scenes.recipe import Recipe
from tsbench.roads.network import Lane
from tsbench.roads.road_map import Crossing

SIDES = ("right", "left")
_PATH_SPEED_MPS = 2.78
_BEND_WINDOW_M = 6
_BEND_AFTER_M = 20.0


def path_name(edge: str, side: str, number: int = 0) -> str:
    """Id of the footpath on one side of a corridor's edge at its first or second crossing."""
    return f"{edge}.path{number}_{side}"


def with_crossings(
    plain: PlainNet, edge: PlainEdge, other: PlainEdge, at: tuple[float, float], recipe: Recipe
) -> PlainNet:
    """The road cut at two places along `edge`, and there crossed; `other`: the edge of the opposite direction."""
    line, across = Polyline(edge.shape), Polyline(other.shape)
    net, parts = split_edge(plain, edge.id, at)
    places = [line.point_at(s) for s in at]
    facing = [across.project(*place) for place in places]
    net, theirs = split_edge(net, other.id, (facing[1][0], facing[0][0]))
    half = edge.num_lanes * _width(edge) / (2.0 if edge.spread == "center" else 1.0)
    share = 2.0 if other.spread == "center" else 1.0
    for k, (x, y) in enumerate(places):
        node = f"{edge.id}.cut{k + 1}"
        net = _joined(net, f"{other.id}.cut{2 - k}", node)
        beyond = abs(facing[k][1]) + other.num_lanes * _width(other) / share
        reach = {"right": half, "left": max(beyond, half if edge.spread == "center" else 0.0)}
        heading = line.heading_at(at[k])
        nodes, paths = [], []
        for side, turn in (("right", -math.pi / 2), ("left", math.pi / 2)):
            far = reach[side] + recipe.number("path_m")
            name = path_name(edge.id, side, k)
            end = PlainNode(f"{name}.end", x + far * math.cos(heading + turn), y + far * math.sin(heading + turn))
            nodes.append(end)
            paths.append(
                PlainEdge(
                    name, end.id, node, 1, _PATH_SPEED_MPS, 1, ((end.x, end.y), (x, y)),
                    width=recipe.number("path_width_m"), spread="center", allow="pedestrian",
                )
            )  # fmt: skip
        crossing = PlainCrossing(node, (parts[k], theirs[2 - k]), recipe.number("crossing_width_m"))
        net = replace(net, nodes=(*net.nodes, *nodes), edges=(*net.edges, *paths), crossings=(*net.crossings, crossing))
    return net


def _width(edge: PlainEdge) -> float:
    return DEFAULT_WIDTH_M if edge.width is None else edge.width


def _joined(net: PlainNet, old: str, new: str) -> PlainNet:
    """The network with one node in place of two."""
    edges = tuple(
        replace(e, source=new if e.source == old else e.source, target=new if e.target == old else e.target)
        for e in net.edges
    )
    return replace(net, nodes=tuple(n for n in net.nodes if n.id != old), edges=edges)


def to_crossing(lane: Lane, crossing: Crossing) -> float:
    """From the end of a lane on to the near edge of the crossing behind it."""
    end = lane.line.point_at(lane.line.length)
    middle = crossing.line.point_at(crossing.line.project(*end)[0])
    return lane.line.project(*middle)[0] - lane.line.length - crossing.width / 2


def bend_speed(lane: Lane, onward: Lane, look_m: float, lateral: float) -> float:
    """What the bends allow in the last `look_m` m of a lane and the first of the next, at `lateral` m/s2, in m/s."""
    line = join([lane.line, onward.line])
    at = np.arange(max(lane.line.length - look_m, 0.0), lane.line.length + _BEND_AFTER_M, 1.0)
    heading = np.unwrap([line.heading_at(float(s)) for s in at])
    turn = np.abs(heading[_BEND_WINDOW_M:] - heading[:-_BEND_WINDOW_M]).max() / _BEND_WINDOW_M
    return math.sqrt(lateral / max(float(turn), 1e-4))


def kerb_to_kerb(crossing: Crossing, lane: Lane, side: str) -> Polyline:
    """The middle line of a crossing from the kerb on one side of the lane that leads up to it."""
    points = crossing.line.points
    right_first = lane.line.project(*points[0])[1] < lane.line.project(*points[-1])[1]
    return crossing.line if right_first == (side == "right") else Polyline(points[::-1])
