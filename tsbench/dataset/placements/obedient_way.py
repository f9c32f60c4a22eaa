"""The way that a plate leaves open: is it short, smooth and free enough that the plate decides, not the traffic?

Units: m, s, degrees.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace
from itertools import pairwise

import numpy as np

from tsbench.dataset.maps.lines import heading_away, heading_towards
from tsbench.dataset.maps.plain import PlainEdge, PlainNet
from tsbench.dataset.placements.placement import require
from tsbench.dataset.scenes.recipe import Recipe
from tsbench.geometry.angles import STRAIGHT, turn_class
from tsbench.geometry.polyline import Polyline
from tsbench.roads.junction_paths import junction_path, path_zones
from tsbench.roads.lane_graph import LaneGraph, Turn
from tsbench.roads.network import Connection, RoadNetwork

# SUMO's state of a connection with right of way.
_MAJOR = "M"
# Of a metre each: how far headings are compared for bends.
_BEND_STEPS = 6
# A car's width, with what its corners swing out in a bend.
_SWEPT_M = 2.2


def drive_time(plain: PlainNet, ways: Sequence[str], recipe: Recipe) -> float:
    """A rough time (s) from the farthest start to the destination on the last edge of `ways`.

    Lengths by limits or by the speed of traffic, and some seconds for each turn. Raises UnfitMapError.
    """
    by_id = {e.id: e for e in plain.edges}
    require(all(e in by_id for e in ways), "an edge of the obedient way is not in the crop")
    edges = [by_id[e] for e in ways]
    inner = [Polyline(e.shape).length for e in edges[1:-1]]
    metres = [recipe.number("ego_farthest_m"), *inner, recipe.number("destination_m")]
    pace = recipe.number("traffic_mps")
    time = sum(m / min(e.speed, pace) for m, e in zip(metres, edges, strict=True))
    return time + recipe.number("turn_s") * sum(turn_between(a, b) != STRAIGHT for a, b in pairwise(edges))


def sharpest_bend(edge: PlainEdge) -> float:
    """Greatest change of heading within 6 m of a road: who turns on the spot meets who comes towards it."""
    line = Polyline(edge.shape)
    heading = np.unwrap([line.heading_at(s) for s in np.arange(0.5, line.length, 1.0)])
    return float(np.degrees(np.abs(heading[_BEND_STEPS:] - heading[:-_BEND_STEPS]).max(initial=0.0)))


def turn_between(edge: PlainEdge, following: PlainEdge) -> str:
    """Class of the turn from one edge to the next."""
    return turn_class(heading_away(np.array(following.shape)) - heading_towards(np.array(edge.shape)))


def main_road(plain: PlainNet, ways: Sequence[str], priority: int) -> PlainNet:
    """The crop with priority for who comes on some edges, whatever way it goes on.

    What traffic at junctions without a plate of the scene costs is not what the scene is about.
    """
    ends = {e.target for e in plain.edges if e.id in ways}
    return replace(
        plain,
        nodes=tuple(replace(n, right_of_way="edgePriority") if n.id in ends else n for n in plain.nodes),
        edges=tuple(replace(e, priority=priority) if e.id in ways else e for e in plain.edges),
    )


def waits(graph: LaneGraph, edge: str, following: str, absent: AbstractSet[Turn] = frozenset()) -> bool:
    """Does who goes from one edge to the next let those go first who need not wait themselves?

    absent: turns that nobody makes.

    Where a main road bends at crossroads, SUMO has its left turn yield to the left turn of a side road too ("m"):
    that one yields to all others in its turn, and holds nobody up.
    """
    lanes = graph.network.lanes
    first = {
        v
        for c in graph.network.connections
        if c.state == _MAJOR and (lanes[c.from_lane].edge, lanes[c.to_lane].edge) not in absent
        for v in c.via
    }
    return any(c.yields_to & first for c in graph.connections(edge, following))


def check_way(graph: LaneGraph, way: Sequence[str], absent: AbstractSet[Turn]) -> None:
    """Raise UnfitMapError where others go first on the finished way, or get in its way without SUMO's knowing.

    absent: turns that nobody makes.
    """
    for a, b in pairwise(way):
        require(not waits(graph, a, b, absent), f"others go first on the obedient way at the end of {a}")
        require(
            not any(_unseen_conflicts(graph.network, graph.connections(a, b))),
            f"vehicles with right of way graze the obedient way at the end of {a}",
        )


def _unseen_conflicts(network: RoadNetwork, own: Sequence[Connection]) -> Iterator[bool]:
    """For each connection with priority of which SUMO says that it never meets ours: does it all the same?

    So where a main road bends sharply: its two directions cut each other's corner.
    """
    lanes = network.lanes
    edges = {lanes[c.from_lane].edge for c in own}, {lanes[c.to_lane].edge for c in own}
    junctions = {network.edges[e].target for e in edges[0]}
    others = [
        c
        for c in network.connections
        if c.state == _MAJOR
        and network.edges[lanes[c.from_lane].edge].target in junctions
        and lanes[c.from_lane].edge not in edges[0]
        and lanes[c.to_lane].edge not in edges[1]
    ]
    ways, crossing = ([junction_path(network, c) for c in some] for some in (own, others))
    zones = path_zones(ways, crossing, width=_SWEPT_M)
    for mine, row in zip(own, zones, strict=True):
        for other, zone in zip(others, row, strict=True):
            known = set(mine.via) & other.yields_to or set(other.via) & mine.yields_to
            yield zone is not None and not known
