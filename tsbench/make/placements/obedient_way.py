"""The way that a plate leaves open: is it short, smooth and free enough that the plate decides, not the traffic?

Units: m, s, degrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
import shapely

from tsbench.geometry.elementary import STRAIGHT, turn_class
from tsbench.geometry.polyline import Polyline, join
from tsbench.make.maps.pieces import heading_away, heading_towards
from tsbench.make.maps.plain import PlainEdge, PlainNet
from tsbench.make.placements.placement import require
from tsbench.make.scenes.recipe import Recipe
from tsbench.make.scenes.traffic import BODIES
from tsbench.roads.junction_paths import junction_path
from tsbench.roads.lane_graph import LaneGraph, Turn
from tsbench.roads.network import Connection, RoadNetwork
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M

# SUMO's state of a connection with right of way.
_MAJOR = "M"
# Of a metre each: how far headings are compared for bends.
_BEND_STEPS = 6
# Footprints that overlap by less do not meet.
_GRAZE_M2 = 0.05


@dataclass(frozen=True)
class _Body:
    """A car's footprint on a path. behind: from its place on the path to its rear.

    That is the middle of the ego, and the front of SUMO's cars, whose body trails along the path's direction.
    """

    length: float
    width: float
    behind: float

    def along(self, line: Polyline, places: Sequence[float]) -> shapely.Geometry:
        """All that it covers at some places of a line."""
        x = np.array([-self.behind, self.length - self.behind, self.length - self.behind, -self.behind])
        y = np.array([-1.0, -1.0, 1.0, 1.0]) * self.width / 2
        heading = np.array([line.heading_at(s) for s in places])[:, None]
        cos, sin, at = np.cos(heading), np.sin(heading), np.array([line.point_at(s) for s in places])
        corners = np.stack((at[:, :1] + x * cos - y * sin, at[:, 1:] + x * sin + y * cos), axis=-1)
        return shapely.union_all(shapely.polygons(corners))


_EGO = _Body(EGO_LENGTH_M, EGO_WIDTH_M, EGO_LENGTH_M / 2)
_LONGEST = _Body(*BODIES["xl"], BODIES["xl"][0])


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
    """Greatest change of heading within 6 m of a road: a vehicle that turns on the spot meets oncoming traffic."""
    line = Polyline(edge.shape)
    heading = np.unwrap([line.heading_at(s) for s in np.arange(0.5, line.length, 1.0)])
    return float(np.degrees(np.abs(heading[_BEND_STEPS:] - heading[:-_BEND_STEPS]).max(initial=0.0)))


def turn_between(edge: PlainEdge, following: PlainEdge) -> str:
    """Class of the turn from one edge to the next."""
    return turn_class(heading_away(np.array(following.shape)) - heading_towards(np.array(edge.shape)))


def main_road(plain: PlainNet, ways: Sequence[str], priority: int) -> PlainNet:
    """The crop with priority for traffic from some edges, whatever its exit.

    What traffic at junctions without a plate of the scene costs is not what the scene is about.
    """
    ends = {e.target for e in plain.edges if e.id in ways}
    return replace(
        plain,
        nodes=tuple(replace(n, right_of_way="edgePriority") if n.id in ends else n for n in plain.nodes),
        edges=tuple(replace(e, priority=priority) if e.id in ways else e for e in plain.edges),
    )


def waits(graph: LaneGraph, edge: str, following: str, absent: AbstractSet[Turn] = frozenset()) -> bool:
    """Must a vehicle from one edge to the next give way to vehicles that need not wait themselves?

    absent: turns that no vehicle makes.

    Where a main road bends at crossroads, SUMO has its left turn yield to the left turn of a side road too ("m"):
    that one yields to all others in its turn, and holds no vehicle up.
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
    """Raise UnfitMapError where others go first on the finished way. absent: turns that no vehicle makes."""
    for a, b in pairwise(way):
        require(not waits(graph, a, b, absent), f"others go first on the obedient way at the end of {a}")


@lru_cache(maxsize=4)
def grazing_turns(graph: LaneGraph, way: tuple[str, ...]) -> frozenset[Turn]:
    """Turns of others whose cars run into a car on a way, or stand in it, without SUMO's knowing.

    So where a road bends sharply at a junction, or meets another at a small angle: long cars cut each other's corner.
    """
    network, found = graph.network, set[Turn]()
    for a, b in pairwise(way):
        own = graph.connections(a, b)
        turning = [_swept(network, c, _EGO) for c in own]
        standing = [_held(network, c, _EGO) for c in own]
        for c in network.connections:
            edge, onto = (network.lanes[i].edge for i in (c.from_lane, c.to_lane))
            if edge == a or network.edges[edge].target != network.edges[a].target:
                continue
            swept, held = _swept(network, c, _LONGEST), _held(network, c, _LONGEST)
            unknown = [
                area
                for mine, area in zip(own, turning, strict=True)
                if onto != b and not set(mine.via) & c.yields_to and not set(c.via) & mine.yields_to
            ]
            met = [(swept, area) for area in (*unknown, *standing)] + [(held, area) for area in turning]
            if any(one.intersection(other).area > _GRAZE_M2 for one, other in met):
                found.add((edge, onto))
    return frozenset(found)


def _swept(network: RoadNetwork, connection: Connection, car: _Body) -> shapely.Geometry:
    """What a car covers on a junction."""
    onto = network.lanes[connection.to_lane].line
    line = join([junction_path(network, connection).line, onto.slice(0.0, min(car.behind, onto.length))])
    return car.along(line, [*np.arange(0.0, line.length, 1.0).tolist(), line.length])


def _held(network: RoadNetwork, connection: Connection, car: _Body) -> shapely.Geometry:
    """Where a car stands that waits at its line."""
    line = network.lanes[connection.from_lane].line
    return car.along(line, [line.length + car.behind - car.length])
