"""The ground that a scene's rule is about, for pictures: read from the target plate's own parameters.

A stretch of road (`zone_edges`; of reserved lanes only these, perhaps those of the opposite direction), the ring of a
roundabout, the zebra, the junction, the ground around the obstacle, or else the road behind the plate's line. Units: m.
"""

from __future__ import annotations

import shapely

from tsbench.geometry.footprint import corners
from tsbench.geometry.overlap import strip
from tsbench.roads.network import Lane, RoadNetwork
from tsbench.signs.annotations import SignInstance
from tsbench.signs.plate_params import (
    ApproachParams,
    CrosswalkParams,
    JunctionParams,
    ObstacleParams,
    ReservedLaneParams,
    RoundaboutParams,
    ZoneParams,
)
from tsbench.sim.scene import Scene

_AROUND_OBSTACLE_M = 2.0


def rule_zone(scene: Scene) -> shapely.Geometry | None:
    """The zone of the target's rule, None where it has no extent."""
    sign, network = scene.target_sign, scene.network
    match sign.params:
        case ReservedLaneParams(zone_edges=edges, lanes=names):
            only = frozenset(names)
            against = [network.lane(name) for name in sorted(only) if network.lane(name).edge not in edges]
            return _against(network, sign, edges, against) if against else _stretch(scene, sign, edges, only)
        case ZoneParams(zone_edges=edges):
            return _stretch(scene, sign, edges, frozenset())
        case RoundaboutParams(ring=ring):
            lanes = [lane for edge in ring for lane in network.edge_lanes(edge)]
            lanes += [lane for a in ring for b in ring for lane in _between(network, a, b, frozenset())]
            return _union([strip(lane.line, lane.width) for lane in lanes])
        case CrosswalkParams(crossing=name):
            crossing = network.crossings[name]
            return strip(crossing.line, crossing.width)
        case ObstacleParams(obstacle=name):
            o = next(o for o in scene.obstacles if o.id == name)
            return shapely.Polygon(corners(o.x, o.y, o.heading, o.length, o.width)).buffer(_AROUND_OBSTACLE_M)
        case JunctionParams(junction=name):
            area = network.junctions[name].polygon
            return shapely.Polygon(area).buffer(0) if len(area) >= 3 else None
        case ApproachParams() | None:
            return _stretch(scene, sign, (sign.edge,), frozenset())
        case params:
            raise TypeError(f"no drawing of the zone of {type(params).__name__}")


def _stretch(
    scene: Scene, sign: SignInstance, edges: tuple[str, ...], only: frozenset[str]
) -> shapely.Geometry | None:
    """The lanes of edges from the plate's line to its end plate's, and what joins them."""
    network = scene.network
    end = next((s for s in scene.signs if s.ends == sign.id), None)
    areas, before = [], ""
    for edge in edges:
        if before:
            areas += [strip(lane.line, lane.width) for lane in _between(network, before, edge, only)]
        for lane in network.edge_lanes(edge):
            if only and lane.id not in only:
                continue
            a = min(sign.position_m, lane.line.length) if edge == sign.edge else 0.0
            b = lane.line.length if end is None or edge != end.edge else min(end.position_m, lane.line.length)
            if b - a > 0.1:
                areas.append(strip(lane.line.slice(a, b), lane.width))
        if end is not None and edge == end.edge:
            break
        before = edge
    return _union(areas)


def _against(
    network: RoadNetwork, sign: SignInstance, edges: tuple[str, ...], lanes: list[Lane]
) -> shapely.Geometry | None:
    """Lanes of the opposite direction, as far as they run beside the edges behind the plate's line."""
    first, last = network.edge_lanes(edges[0])[-1].line, network.edge_lanes(edges[-1])[-1].line
    ends = (first.point_at(min(sign.position_m, first.length)), last.point_at(last.length))
    areas = []
    for lane in lanes:
        a, b = sorted(lane.line.project(*end)[0] for end in ends)
        if b - a > 0.1:
            areas.append(strip(lane.line.slice(a, b), lane.width))
    return _union(areas)


def _between(network: RoadNetwork, source: str, target: str, only: frozenset[str]) -> list[Lane]:
    lanes = network.lanes
    return [
        lanes[via]
        for i in network.edges[source].lanes
        for c in network.outgoing[i]
        if lanes[c.to_lane].edge == target and (not only or lanes[c.to_lane].id in only)
        for via in c.via
    ]


def _union(areas: list[shapely.Geometry]) -> shapely.Geometry | None:
    return shapely.union_all(areas) if areas else None
