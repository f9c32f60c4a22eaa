"""The road surface and its markings as shapes. Units: m, rad."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely

from tsbench.geometry.overlap import strip
from tsbench.geometry.polyline import Polyline
from tsbench.report.drawing.shapes import Area, Line, dashes
from tsbench.report.drawing.style import STYLE
from tsbench.roads.network import Edge, Lane, RoadNetwork
from tsbench.roads.road_map import Crossing

_ROUND_M = 0.15
_KERB_M = 0.25
_SOLID_STATES = frozenset("swoOrRyYuUgG")
_GIVE_WAY_STATES = frozenset("m=")
_TOOTH_M = (0.35, 0.75)
_ZEBRA_M = (0.5, 0.5)
# Where people wait, beyond the kerb: as deep as netconvert makes it, and wider than the crossing.
_APRON_M = (3.0, 1.6)


def road_shapes(network: RoadNetwork) -> Iterator[Area | Line]:
    walks = [strip(lane.line, lane.width) for lane in network.lanes if _is_walk(lane)]
    aprons = shapely.union_all([a for c in network.crossings.values() for a in _aprons(c)])
    area = _carriageway(network)
    yield Area("walk", shapely.union_all([*walks, area.intersection(aprons)]))
    road = area.difference(aprons)
    yield Area("kerb", road.buffer(_KERB_M))
    yield Area("asphalt", road)
    for lane in network.lanes:
        if not lane.internal and not lane.permits("passenger") and not _is_walk(lane):
            yield Area("reserved", strip(lane.line, lane.width))
    opposite = {
        (e.target, e.source) for e in network.edges.values() if not e.internal and _drivable(network, e)
    }
    for edge in network.edges.values():
        lanes = _drivable(network, edge)
        if edge.internal or not lanes:
            continue
        yield from _edge_marks(lanes, (edge.source, edge.target) in opposite, network.to_kerb)
        for lane in lanes:
            yield from _end_marks(network, lane)
    for crossing in network.crossings.values():
        for dash in dashes(crossing.line.points, *_ZEBRA_M):
            yield Area("marking", strip(Polyline(dash), crossing.width))


def _aprons(crossing: Crossing) -> list[shapely.Geometry]:
    deep, wider = _APRON_M
    line, width = crossing.line, crossing.width + 2.0 * wider
    return [strip(line.slice(-deep, 0.0), width), strip(line.slice(line.length, line.length + deep), width)]


def _carriageway(network: RoadNetwork) -> shapely.Geometry:
    """All lanes for wheels and all junction areas, as one area."""
    parts = [strip(lane.line, lane.width) for lane in network.lanes if not _is_walk(lane)]
    parts += [
        shapely.Polygon(j.polygon).buffer(0)
        for j in network.junctions.values()
        if len(j.polygon) >= 3 and j.type != "dead_end"
    ]
    # Closing with a small radius hides the hairlines between strips that only touch.
    return shapely.union_all(parts).buffer(_ROUND_M).buffer(-_ROUND_M)


def _is_walk(lane: Lane) -> bool:
    return lane.permits("pedestrian") and not any(lane.permits(c) for c in ("passenger", "bus", "bicycle"))


def _drivable(network: RoadNetwork, edge: Edge) -> list[Lane]:
    return [network.lanes[i] for i in edge.lanes if not _is_walk(network.lanes[i])]


def _edge_marks(lanes: list[Lane], two_way: bool, kerb: float) -> Iterator[Line]:
    width, inset = STYLE.marking_m, 0.15
    outer, inner = lanes[0], lanes[-1]
    yield Line("marking", outer.line.beside(kerb * (outer.width / 2 - inset)), width)
    # On a two-way road both directions draw their own half of the centre line.
    shift = inset * 0.8 if two_way else inset
    yield Line("marking", inner.line.beside(-kerb * (inner.width / 2 - shift)), width)
    for lane in lanes[:-1]:
        for dash in dashes(lane.line.beside(-kerb * lane.width / 2), *STYLE.dash_m):
            yield Line("marking", dash, width)


def _end_marks(network: RoadNetwork, lane: Lane) -> Iterator[Line]:
    """The line that the strictest of the lane's connections asks for."""
    links = [c for c in network.outgoing[lane.index] if c.direction != "t"]
    states = {c.state for c in links}
    if "M" in states or (states <= _GIVE_WAY_STATES and not any(c.yields_to for c in links)):
        # A main road: only its left turns give way, and nobody paints a line for them; nor before a zebra.
        return
    end = lane.line.length - STYLE.stop_line_m / 2
    across = [lane.line.point_at(end, lane.width / 2 - 0.2), lane.line.point_at(end, -lane.width / 2 + 0.2)]
    if states & _SOLID_STATES:
        yield Line("marking", np.array(across), STYLE.stop_line_m)
    elif states & _GIVE_WAY_STATES:
        for tooth in dashes(np.array(across), *_TOOTH_M):
            yield Line("marking", tooth, STYLE.stop_line_m)
