"""The road surface and its markings, drawn once per scene. Units: m, rad."""

from __future__ import annotations

import cv2
import numpy as np
import shapely

from tsbench.geometry.overlap import strip
from tsbench.geometry.polyline import Array, Polyline
from tsbench.maps.network import Crossing, Edge, Lane, RoadNetwork
from tsbench.report.camera import SHIFT, Camera, Image
from tsbench.report.style import STYLE, Colour

_ROUND_M = 0.15
_KERB_M = 0.25
_SOLID_STATES = frozenset("swoOrRyYuUgG")
_GIVE_WAY_STATES = frozenset("m=")
_TOOTH_M = (0.35, 0.75)
_ZEBRA_M = (0.5, 0.5)
# Where people wait, beyond the kerb: as deep as netconvert makes it, and wider than the crossing.
_APRON_M = (3.0, 1.6)


def draw_roads(image: Image, camera: Camera, network: RoadNetwork) -> None:
    """Ground, pavements, carriageways with their kerbs, lane markings, zebras, stop and give-way lines."""
    image[:] = STYLE.ground
    walks = [strip(lane.line, lane.width) for lane in network.lanes if _is_walk(lane)]
    aprons = shapely.union_all([a for c in network.crossings.values() for a in _aprons(c)])
    area = _carriageway(network)
    fill(image, camera, shapely.union_all([*walks, area.intersection(aprons)]), STYLE.walk)
    road = area.difference(aprons)
    fill(image, camera, road.buffer(_KERB_M), STYLE.kerb)
    fill(image, camera, road, STYLE.asphalt)
    for lane in network.lanes:
        if not lane.internal and not lane.permits("passenger") and not _is_walk(lane):
            fill(image, camera, strip(lane.line, lane.width), STYLE.reserved)
    opposite = {
        (e.target, e.source) for e in network.edges.values() if not e.internal and _drivable(network, e)
    }
    for edge in network.edges.values():
        lanes = _drivable(network, edge)
        if edge.internal or not lanes:
            continue
        _mark_edge(image, camera, lanes, two_way=(edge.source, edge.target) in opposite)
        for lane in lanes:
            _mark_end(image, camera, network, lane)
    for crossing in network.crossings.values():
        for dash in dashes(crossing.line, *_ZEBRA_M):
            fill(image, camera, strip(Polyline(dash), crossing.width), STYLE.marking)


def _aprons(crossing: Crossing) -> list[shapely.Geometry]:
    """What lies beyond the kerbs at both ends of a crossing."""
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


def _mark_edge(image: Image, camera: Camera, lanes: list[Lane], two_way: bool) -> None:
    width = camera.thickness(STYLE.marking_m)
    inset = 0.15
    right, left = lanes[0], lanes[-1]
    draw_line(image, camera, right.line.beside(-right.width / 2 + inset), STYLE.marking, width)
    # On a two-way road both directions draw their own half of the centre line.
    draw_line(
        image,
        camera,
        left.line.beside(left.width / 2 - (inset * 0.8 if two_way else inset)),
        STYLE.marking,
        width,
    )
    for lane in lanes[:-1]:
        for dash in dashes(Polyline(lane.line.beside(lane.width / 2)), *STYLE.dash_m):
            draw_line(image, camera, dash, STYLE.marking, width)


def _mark_end(image: Image, camera: Camera, network: RoadNetwork, lane: Lane) -> None:
    """The line that the strictest of the lane's connections asks for."""
    links = [c for c in network.outgoing[lane.index] if c.direction != "t"]
    states = {c.state for c in links}
    if "M" in states or (states <= _GIVE_WAY_STATES and not any(c.yields_to for c in links)):
        # A main road: only its left turns give way, and nobody paints a line for them; nor before a zebra.
        return
    end = lane.line.length - STYLE.stop_line_m / 2
    across = [lane.line.point_at(end, lane.width / 2 - 0.2), lane.line.point_at(end, -lane.width / 2 + 0.2)]
    if states & _SOLID_STATES:
        draw_line(image, camera, np.array(across), STYLE.marking, camera.thickness(STYLE.stop_line_m))
    elif states & _GIVE_WAY_STATES:
        for tooth in dashes(Polyline(across), *_TOOTH_M):
            draw_line(image, camera, tooth, STYLE.marking, camera.thickness(STYLE.stop_line_m))


def dashes(line: Polyline, dash: float, gap: float) -> list[Array]:
    """Pieces of a line, (n, 2) each."""
    starts = np.arange(0.0, max(line.length - dash / 2, 0.01), dash + gap)
    return [
        line.slice(s, min(s + dash, line.length)).points for s in starts.tolist() if s + 0.01 < line.length
    ]


def draw_line(image: Image, camera: Camera, points: Array, colour: Colour, thickness: int) -> None:
    """An open polyline (n, 2)."""
    cv2.polylines(image, [camera.fixed(points)], False, colour, thickness, cv2.LINE_AA, SHIFT)


def fill(image: Image, camera: Camera, area: shapely.Geometry, colour: Colour) -> None:
    """An area with its holes."""
    for polygon in shapely.get_parts(area):
        if polygon.geom_type == "Polygon" and not polygon.is_empty:
            rings = [polygon.exterior, *polygon.interiors]
            fixed = [camera.fixed(shapely.get_coordinates(ring)) for ring in rings]
            cv2.fillPoly(image, fixed, colour, cv2.LINE_AA, SHIFT)
