"""The ground that a scene's rule is about, for pictures: read from the target plate's own parameters.

Source of the parameters: docs/rules.md, "Plate params" of each rule. Which area stands for a rule:
a stretch of road (`zone_edges`; of reserved lanes only these), the ring of a roundabout, the zebra, the junction, the
ground around the obstacle, or else the road behind the plate's line. Units: m.
"""

from __future__ import annotations

import shapely

from tsbench.geometry.footprint import corners
from tsbench.geometry.overlap import strip
from tsbench.maps.network import Lane, RoadNetwork
from tsbench.signs.annotations import SignInstance
from tsbench.sim.scene import Scene

_AROUND_OBSTACLE_M = 2.0


def rule_zone(scene: Scene) -> shapely.Geometry | None:
    """The zone of the target's rule, None where it has no extent."""
    sign, network = scene.target_sign, scene.network
    named = {key: text.split() for key, text in sign.params.items()}
    if "zone_edges" in named:
        return _stretch(scene, sign, named["zone_edges"], frozenset(named.get("lanes", ())))
    if "ring" in named:
        return _union([strip(lane.line, lane.width) for e in named["ring"] for lane in network.edge_lanes(e)])
    if "crossing" in named:
        found = [network.crossings[name] for name in named["crossing"] if name in network.crossings]
        return _union([strip(c.line, c.width) for c in found])
    if "obstacle" in named:
        near = [o for o in scene.obstacles if o.id in named["obstacle"]]
        boxes = [shapely.Polygon(corners(o.x, o.y, o.heading, o.length, o.width)) for o in near]
        return _union([box.buffer(_AROUND_OBSTACLE_M) for box in boxes])
    if "junction" in named:
        areas = [network.junctions[name].polygon for name in named["junction"] if name in network.junctions]
        return _union([shapely.Polygon(area).buffer(0) for area in areas if len(area) >= 3])
    return _stretch(scene, sign, [sign.edge], frozenset())


def _stretch(
    scene: Scene, sign: SignInstance, edges: list[str], only: frozenset[str]
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


def _between(network: RoadNetwork, source: str, target: str, only: frozenset[str]) -> list[Lane]:
    """The lanes through the junction between two edges."""
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
