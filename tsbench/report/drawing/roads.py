"""The road surface and its markings as shapes. Units: m, rad."""

from __future__ import annotations

import math
from collections.abc import Iterator
from types import MappingProxyType

import numpy as np
import shapely

from tsbench.geometry.overlap import strip
from tsbench.geometry.polyline import Polyline
from tsbench.report.drawing.curves import lane_area, rounded
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
    walks = [lane_area(lane.line, lane.width) for lane in network.lanes if _is_walk(lane)]
    aprons = shapely.union_all([a for c in network.crossings.values() for a in _aprons(c)])
    area = _carriageway(network)
    yield Area("walk", shapely.union_all([*walks, area.intersection(aprons)]))
    road = area.difference(aprons)
    yield Area("kerb", road.buffer(_KERB_M))
    yield Area("asphalt", road)
    for lane in network.lanes:
        if not lane.internal and not lane.permits("passenger") and not _is_walk(lane):
            yield Area("reserved", lane_area(lane.line, lane.width))
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
            yield from _arrows(network, lane, one_way=(edge.source, edge.target) not in opposite)
    for crossing in network.crossings.values():
        for dash in dashes(crossing.line.points, *_ZEBRA_M):
            yield Area("marking", strip(Polyline(dash), crossing.width))


def _aprons(crossing: Crossing) -> list[shapely.Geometry]:
    deep, wider = _APRON_M
    line, width = crossing.line, crossing.width + 2.0 * wider
    return [strip(line.slice(-deep, 0.0), width), strip(line.slice(line.length, line.length + deep), width)]


def _carriageway(network: RoadNetwork) -> shapely.Geometry:
    """All lanes for wheels and all junction areas, as one area."""
    parts = [lane_area(lane.line, lane.width) for lane in network.lanes if not _is_walk(lane)]
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
    yield Line("marking", rounded(outer.line).beside(kerb * (outer.width / 2 - inset)), width)
    # On a two-way road both directions draw their own half of the centre line.
    shift = inset * 0.8 if two_way else inset
    yield Line("marking", rounded(inner.line).beside(-kerb * (inner.width / 2 - shift)), width)
    for lane in lanes[:-1]:
        for dash in dashes(rounded(lane.line).beside(-kerb * lane.width / 2), *STYLE.dash_m):
            yield Line("marking", dash, width)


def _end_marks(network: RoadNetwork, lane: Lane) -> Iterator[Line]:
    """The line that the strictest of the lane's connections asks for."""
    links = [c for c in network.outgoing[lane.index] if c.direction not in _BACK]
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


# Heads of arrows: where each points to, from the shaft's front end, in the frame of the lane (ahead, left).
_SHAFT_M, _HEAD_M, _ARROW_M = 3.0, (1.5, 0.55), 0.22
_TIPS = MappingProxyType(
    {"s": (1.7, 0.0), "l": (0.5, 1.0), "r": (0.5, -1.0), "t": (-0.6, 1.0), "T": (-0.6, -1.0)}
)
_BACK = frozenset("tT")
_LEANS = MappingProxyType({"L": "l", "R": "r"})
# So far before the end of its lane an arrow's front stands, and from so long a lane on.
_BEFORE_END_M, _LEAST_LANE_M = 12.0, 22.0


def _arrows(network: RoadNetwork, lane: Lane, one_way: bool) -> Iterator[Area | Line]:
    """Where a lane leads, painted before a fork; on a one-way road without a fork which way it goes."""
    if not lane.permits("passenger") or lane.line.length < _LEAST_LANE_M:
        return
    turns = {_LEANS.get(c.direction, c.direction) for c in network.outgoing[lane.index]} & set(_TIPS)
    forks = len({c.direction for i in _beside(network, lane) for c in network.outgoing[i]} - _BACK) > 1
    if forks and turns - _BACK:
        yield from _arrow(lane, lane.line.length - _BEFORE_END_M, turns)
    elif one_way:
        yield from _arrow(lane, 0.5 * lane.line.length, {"s"})


def _beside(network: RoadNetwork, lane: Lane) -> tuple[int, ...]:
    return network.edges[lane.edge].lanes


def _arrow(lane: Lane, front: float, turns: set[str]) -> Iterator[Area | Line]:
    line = rounded(lane.line)
    (x, y), heading = line.point_at(front), line.heading_at(front)
    turned = np.array([[math.cos(heading), math.sin(heading)], [-math.sin(heading), math.cos(heading)]])
    for turn in sorted(turns):
        tip = np.array(_TIPS[turn])
        way = tip / np.hypot(*tip)
        aside, root = _HEAD_M[1] * np.array([-way[1], way[0]]), tip - 0.5 * _HEAD_M[0] * way
        yield Line("marking", np.array([(-_SHAFT_M, 0.0), (0.0, 0.0), root]) @ turned + (x, y), _ARROW_M)
        head = np.array([tip + 0.5 * _HEAD_M[0] * way, root + aside, root - aside]) @ turned + (x, y)
        yield Area("marking", shapely.Polygon(head))
