"""The road surface, its markings and the ground around it (buildings, greenery, water) as shapes. Units: m, rad.

Plate 8.13 as a picture.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType

import numpy as np
import shapely
from PIL import Image as PilImage
from resvg_py import svg_to_bytes

from tsbench.core.parquet import GROUND_FILE, GROUND_KINDS, GROUND_SCHEMA, open_table
from tsbench.geometry.overlap import strip
from tsbench.geometry.polyline import Polyline
from tsbench.report.drawing.canvas import STYLE, Area, Image, Line, dashes, lane_area, rounded
from tsbench.roads.network import Edge, Lane, RoadNetwork
from tsbench.roads.road_map import Crossing
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.annotations import TARGET, SignInstance
from tsbench.signs.rule_kinds import ReservedLaneParams
from tsbench.sim import main_road
from tsbench.sim.main_road import MainRoad
from tsbench.sim.scene import Scene

_ROUND_M = 0.15
_KERB_M, _LINES_M = 0.25, 0.25
_STOP, _GIVE_WAY, _NO_LINE = "stop", "give_way", "none"
_ASKS = ((main_road.MAIN, _NO_LINE), (main_road.GIVE_WAY, _GIVE_WAY), (main_road.STOP, _STOP))
# A lane beside another one: so far from where it would touch it, in widths; and its direction against the other's.
_BESIDE, _BACK_COS = 0.6, -0.9
_SOLID_STATES = frozenset("swoOrRyYuUgG")
_GIVE_WAY_STATES = frozenset("m=")
_TOOTH_M = (0.35, 0.75)
_ZEBRA_M = (0.5, 0.5)
# From the end of a crossing to its plate.
_AT_CROSSING_M = 8.0
# Rules whose plates stand on an approach, and at the mouth of an exit, and say which ways are open.
_APPROACH_RULES = frozenset({"manoeuvre", "one_way_exit"})
# From this angle on (sine) a road at a junction lies across an approach.
_ACROSS_SIN = 0.6
_MOUTH_RULES = frozenset({"no_entry", "closed_road"})
# Where people wait, beyond the kerb: as deep as netconvert makes it, and wider than the crossing.
_APRON_M = (3.0, 1.6)


_MAIN_PX, _OTHER_PX, _REACH_PX = 30, 11, 78


def road_shapes(network: RoadNetwork, scene: Scene | None = None) -> Iterator[Area | Line]:
    """Surface, kerbs and lines. A road across a plate of one-way traffic has no lines: its plates alone say the way."""
    walks = [lane_area(lane.line, lane.width) for lane in network.lanes if _is_walk(lane)]
    aprons = shapely.union_all([a for c in network.crossings.values() for a in _aprons(c)])
    area = _carriageway(network)
    yield Area("walk", shapely.union_all([*walks, area.intersection(aprons)]))
    road = area.difference(aprons)
    yield Area("kerb", road.buffer(_KERB_M))
    yield Area("asphalt", road)
    two_way, across = _two_way(network), _across(scene)
    for edge in network.edges.values():
        lanes = _drivable(network, edge)
        if edge.internal or not lanes or edge.id in across:
            continue
        yield from _edge_marks(lanes, edge.id in two_way, network.to_kerb)
        for lane in lanes if edge.id not in two_way else ():
            yield from _one_way_arrows(network, lane)


def _two_way(network: RoadNetwork) -> set[str]:
    """Edges beside whose inner lane another one leads back; where a crop was cut, they end at nodes of their own."""
    inner = [lanes[-1] for e in network.edges.values() if not e.internal and (lanes := _drivable(network, e))]
    tree = shapely.STRtree([shapely.LineString(lane.line.points) for lane in inner])
    found = set()
    for lane in inner:
        middle, heading = 0.5 * lane.line.length, lane.line.heading_at(0.5 * lane.line.length)
        beyond = shapely.Point(lane.line.point_at(middle, -network.to_kerb * lane.width))
        for k in tree.query(beyond, predicate="dwithin", distance=_BESIDE * lane.width).tolist():
            s, _ = inner[k].line.project(beyond.x, beyond.y)
            if math.cos(inner[k].line.heading_at(s) - heading) < _BACK_COS:
                found.add(lane.edge)
    return found


def _across(scene: Scene | None) -> set[str]:
    """Edges of the roads whose direction targets of one-way traffic (5.7.x) alone tell."""
    found = set[str]()
    if scene is None:
        return found
    network = scene.network
    for sign in scene.plates("one_way_exit"):
        if sign.role == TARGET:
            node = network.edges[sign.edge].target
            for edge in network.edges.values():
                if not edge.internal and node in (edge.source, edge.target):
                    line = network.edge_lanes(edge.id)[0].line
                    heading = line.heading_at(0.0 if edge.source == node else line.length)
                    if abs(math.sin(heading - sign.heading)) > _ACROSS_SIN:
                        found.add(edge.id)
    return found


def mark_shapes(network: RoadNetwork, scene: Scene | None = None) -> Iterator[Area | Line]:
    """What plates have painted: reserved lanes, stop and give-way lines, the stripes of a crossing with its plate.

    An arm without a plate of priority has the line that the network's rights of way ask for. Lanes have arrows before
    a fork, except where a plate of the scene says which ways are open or a road's direction: the other half's plate
    says otherwise.
    """
    signs = () if scene is None else scene.signs
    lanes, posts = (scene.plates(rule) if scene else [] for rule in ("reserved_lane", "crosswalk"))
    reserved = {name for s in signs if isinstance(s.params, ReservedLaneParams) for name in s.params.lanes}
    # Of plates that bind others: the lane that each names.
    others = (s for s in lanes if s.params is None and s.lane >= 0)
    reserved |= {network.edge_lanes(s.edge)[s.lane].id for s in others}
    for name in sorted(reserved):
        lane = network.lane(name)
        # Between the lines at its sides.
        yield Area("reserved", lane_area(lane.line, lane.width - 2.0 * _LINES_M))
    regulated, across = _regulated(scene), _across(scene)
    for index, line in stop_lines(network, signs).items():
        if network.lanes[index].edge not in across:
            yield from _end_marks(network.lanes[index], line)
    regulated |= {node for edge in across for node in (network.edges[edge].source, network.edges[edge].target)}
    for lane in network.lanes:
        if not lane.internal and network.edges[lane.edge].target not in regulated:
            yield from _turn_arrows(network, lane)
    two_way = _two_way(network) if network.crossings else set()
    for crossing in network.crossings.values():
        ends = crossing.line.points
        if any(math.dist((post.x, post.y), end) <= _AT_CROSSING_M for post in posts for end in ends):
            for dash in dashes(ends, *_ZEBRA_M):
                yield Area("marking", strip(Polyline(dash), crossing.width))
        else:
            yield from _lines_across(network, crossing, not two_way.isdisjoint(crossing.edges))


def _lines_across(network: RoadNetwork, crossing: Crossing, two_way: bool) -> Iterator[Line]:
    """The lines of the crossed road, which go on where no plate makes people cross."""
    inside = crossing.id.rpartition("_")[0] + "_"
    for name, edge in network.edges.items():
        if name.startswith(inside) and (lanes := _drivable(network, edge)):
            yield from _edge_marks(lanes, two_way, network.to_kerb)


def _regulated(scene: Scene | None) -> set[str]:
    """Nodes at which plates say which ways are open."""
    if scene is None:
        return set()
    edges = scene.network.edges
    approached = {edges[sign.edge].target for sign in scene.plates(*_APPROACH_RULES)}
    return approached | {edges[sign.edge].source for sign in scene.plates(*_MOUTH_RULES)}


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


def stop_lines(network: RoadNetwork, signs: Sequence[SignInstance] = ()) -> dict[int, str]:
    """By lane index: the line across its end, `stop` or `give_way`; lanes without one are left out."""
    asked = {sign.edge: line for sign in signs for codes, line in _ASKS if sign.code in codes}
    lanes = [lane for e in network.edges.values() if not e.internal for lane in _drivable(network, e)]
    found = {lane.index: asked.get(lane.edge) or _line_by_rights(network, lane) for lane in lanes}
    return {index: line for index, line in found.items() if line in (_STOP, _GIVE_WAY)}


def _line_by_rights(network: RoadNetwork, lane: Lane) -> str:
    """The line that the strictest of the lane's connections asks for."""
    links = [c for c in network.outgoing[lane.index] if c.direction not in _BACK]
    states = {c.state for c in links}
    if "M" in states or (states <= _GIVE_WAY_STATES and not any(c.yields_to for c in links)):
        # A main road: only its left turns give way, without a painted line; nor before a zebra.
        return _NO_LINE
    if states & _SOLID_STATES:
        return _STOP
    return _GIVE_WAY if states & _GIVE_WAY_STATES else _NO_LINE


def _end_marks(lane: Lane, line: str) -> Iterator[Line]:
    """Solid for `stop`, of teeth for `give_way`."""
    end = lane.line.length - STYLE.stop_line_m / 2
    across = [lane.line.point_at(end, lane.width / 2 - 0.2), lane.line.point_at(end, -lane.width / 2 + 0.2)]
    if line == _STOP:
        yield Line("marking", np.array(across), STYLE.stop_line_m)
    else:
        for tooth in dashes(np.array(across), *_TOOTH_M):
            yield Line("marking", tooth, STYLE.stop_line_m)


# Arrows in the frame of the lane (m ahead, m to the left) of 3.2 m: the shaft behind, and of each way its line from the
# shaft on with the direction in which its head points.
_SHAFT_M, _HEAD_M, _ARROW_M, _FITS_M = 3.0, (1.0, 0.42), 0.2, 3.2
_POINT_M = 2.6  # from the end of the shaft to the point of an arrow straight on
_WAYS_M = MappingProxyType(
    {
        "s": (((0.0, 0.0), (1.6, 0.0)), (1.0, 0.0)),
        "l": (((-0.6, 0.0), (0.1, 0.1), (0.5, 0.35), (0.6, 0.55)), (0.0, 1.0)),
        "t": (((-0.6, 0.0), (0.1, 0.1), (0.3, 0.45), (0.1, 0.8), (-0.3, 0.9)), (-1.0, 0.0)),
        "m": (((-0.6, 0.0), (0.2, 0.1), (0.8, 0.4)), (0.8, 0.6)),
    }
)
_MIRRORED = MappingProxyType({"r": "l", "T": "t", "M": "m"})
_BACK = frozenset("tT")
_LEANS = MappingProxyType({"L": "l", "R": "r"})
# So far before the end of its lane the front of a turn's arrow stands, in the middle of a short one; one-way arrows
# are so far apart. A lane shorter than the last has none.
_BEFORE_END_M, _APART_M, _LEAST_LANE_M = 12.0, 35.0, 9.0
_LENGTH_M = 5.6  # of an arrow straight on


def _turns(network: RoadNetwork, lane: Lane) -> set[str]:
    """Ways that a lane leads before a fork; none where it has no arrow."""
    if not lane.permits("passenger") or lane.line.length < _LEAST_LANE_M:
        return set()
    turns = {_LEANS.get(c.direction, c.direction) for c in network.outgoing[lane.index]}
    turns &= {*_WAYS_M, *_MIRRORED}
    forks = len({c.direction for i in network.edges[lane.edge].lanes for c in network.outgoing[i]} - _BACK) > 1
    return turns if forks and turns - _BACK else set()


def _merges(network: RoadNetwork, lane: Lane) -> str:
    """The side, m left or M right, to which a lane is left that ends beside lanes that lead on; "" of another."""
    others = [network.lanes[i] for i in network.edges[lane.edge].lanes if network.outgoing[i]]
    if network.outgoing[lane.index] or not others:
        return ""
    nearest = min(others, key=lambda other: abs(other.order - lane.order))
    return "M" if (nearest.order < lane.order) != network.left_hand else "m"


def _turn_arrows(network: RoadNetwork, lane: Lane) -> Iterator[Area | Line]:
    """Where a lane leads, painted before a fork."""
    if turns := _turns(network, lane):
        length = lane.line.length
        front = max(length - _BEFORE_END_M, 0.5 * (length + _LENGTH_M)) - _POINT_M
        yield from _arrow(lane, front, turns)


def _one_way_arrows(network: RoadNetwork, lane: Lane) -> Iterator[Area | Line]:
    """Again and again which way a one-way road goes, or to which side a lane of it is left."""
    if not lane.permits("passenger"):
        return
    plain = _BEFORE_END_M + _APART_M / 2 if _turns(network, lane) else 0.0
    length = lane.line.length - plain
    if length >= _LEAST_LANE_M:
        count, way = max(round(length / _APART_M), 1), _merges(network, lane) or "s"
        for k in range(count):
            yield from _arrow(lane, (k + 0.5) * length / count + 0.5 * _LENGTH_M - _POINT_M, {way})


def _arrow(lane: Lane, front: float, turns: set[str]) -> Iterator[Area | Line]:
    """front: where the shaft ends, m along the lane."""
    line = rounded(lane.line)
    (x, y), heading = line.point_at(front), line.heading_at(front)
    turned = np.array([[math.cos(heading), math.sin(heading)], [-math.sin(heading), math.cos(heading)]])
    small = min(lane.width / _FITS_M, 1.0)
    for turn in sorted(turns):
        points, way = _WAYS_M[_MIRRORED.get(turn, turn)]
        side = np.array([1.0, -1.0 if turn in _MIRRORED else 1.0]) * small
        length, half = _HEAD_M
        root, ahead = np.array(points[-1]), np.array(way)
        aside = half * np.array([-ahead[1], ahead[0]])
        shaft = np.array([(-_SHAFT_M, 0.0), *points])
        yield Line("marking", shaft * side @ turned + (x, y), _ARROW_M)
        head = np.array([root + length * ahead, root + aside, root - aside])
        yield Area("marking", shapely.Polygon(head * side @ turned + (x, y)))


_MIRROR = np.array((-1.0, 1.0))


def ground_shapes(scene: Scene, map_id: str) -> tuple[Area, ...]:
    """Of a scene's map, lowest first; () where nothing is known. Raises InputError: a broken file."""
    path = DataSet(scene.city).file(GROUND_FILE)
    if not path.is_file():
        return ()
    shapes = _ground_of_maps(path).get(map_id, ())
    if scene.catalog.image is None:
        return shapes
    return tuple(Area(one.colour, shapely.transform(one.polygon, lambda points: points * _MIRROR)) for one in shapes)


@lru_cache(maxsize=4)
def _ground_of_maps(path: Path) -> MappingProxyType[str, tuple[Area, ...]]:
    found: dict[str, list[Area]] = {}
    for row in open_table(path, GROUND_SCHEMA, "tsbench city ground NAME --osm DIR").to_pylist():
        if row["kind"] in GROUND_KINDS:
            found.setdefault(row["map_id"], []).append(Area(row["kind"], shapely.from_wkb(row["shape"])))
    return MappingProxyType({name: tuple(shapes) for name, shapes in found.items()})


def main_road_svg(key: str) -> str:
    """The plate of a name (`MainRoad.key`) as an SVG document of 200 x 200 units."""
    road = MainRoad.of(key)
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 200 200"><title>8.13 Main road\'s direction</title>'
        '<rect x="3" y="3" width="194" height="194" rx="12" fill="#ffffff" stroke="#1a1a1a" stroke-width="6"/>'
        '<g fill="none" stroke="#1a1a1a" stroke-linejoin="round">'
        f"{''.join(_way((angle,), _OTHER_PX) for angle in road.others)}{_way(road.main, _MAIN_PX)}</g></svg>"
    )


def _way(angles: Sequence[int], width: int) -> str:
    """A road through the middle (two angles), or to it (one)."""
    ends = [(100 - _REACH_PX * math.sin(math.radians(a)), 100 - _REACH_PX * math.cos(math.radians(a))) for a in angles]
    points = [ends[0], (100.0, 100.0), *ends[1:]]
    return f'<polyline stroke-width="{width}" points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in points)}"/>'


@lru_cache(maxsize=256)
def main_road_rgba(key: str, size_px: int) -> Image:
    """The plate of a name, read-only (size_px, size_px, 4), RGB with straight alpha."""
    png = svg_to_bytes(svg_string=main_road_svg(key), width=size_px, height=size_px, skip_system_fonts=True)
    with PilImage.open(io.BytesIO(png)) as picture:
        pixels = np.array(picture.convert("RGBA"))
    pixels.setflags(write=False)
    return pixels
