"""A crop's lanes and plates as CommonRoad lanelets and traffic signs (format 2020a). Units: m, rad."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping
from itertools import pairwise

from lxml.builder import E

from tsbench.geometry.polyline import Polyline
from tsbench.report.drawing.main_road import GIVE_WAY, STOP
from tsbench.report.drawing.roads import stop_lines
from tsbench.report.drawing.style import STYLE
from tsbench.report.export.elements import Element, number, point, points
from tsbench.report.export.intersections import opposite_lanes
from tsbench.report.export.pieces import Piece
from tsbench.roads.network import Lane, RoadNetwork
from tsbench.signs.annotations import SignInstance
from tsbench.signs.commonroad import SIGN_NUMBERS
from tsbench.sim.scene import Scene

_MPS_PER_KMH = 1 / 3.6
_USERS = (("passenger", "car"), ("bus", "bus"), ("bicycle", "bicycle"), ("pedestrian", "pedestrian"))


def lanelets(
    scene: Scene, cut: Mapping[int, tuple[Piece, ...]], sign_ids: dict[str, int], free_ids: Iterator[int]
) -> list[Element]:
    """All lanes in their pieces, and all crossings with the next free ids."""
    network = scene.network
    after = _successors(network, cut)
    before: dict[int, list[int]] = {lanelet: [] for lanelet in after}
    for lanelet, following in after.items():
        for other in following:
            before[other].append(lanelet)
    against = opposite_lanes(network)
    lines = stop_lines(network, scene.signs)
    found = []
    for index, parts in cut.items():
        lane = network.lanes[index]
        sides = (("Left", lane.left), ("Right", lane.right))
        beside = {side: (other, "same") for side, other in sides if other in cut}
        if index in against:
            beside["Right" if network.left_hand else "Left"] = (against[index], "opposite")
        users = [user for vclass, user in _USERS if lane.permits(vclass)]
        for k, piece in enumerate(parts):
            line = lane.line if len(parts) == 1 else lane.line.slice(piece.begins, piece.ends)
            found.append(
                E.lanelet(
                    *_bounds(line, lane.width, *(_marking(lane, other, cut) for _, other in sides)),
                    *(E.predecessor(ref=str(other)) for other in before[piece.lanelet]),
                    *(E.successor(ref=str(other)) for other in after[piece.lanelet]),
                    *(
                        E(f"adjacent{side}", ref=str(cut[other][k].lanelet), drivingDir=way)
                        for side, (other, way) in sorted(beside.items())
                        if len(cut[other]) == len(parts) and (way == "same" or len(parts) == 1)
                    ),
                    *(
                        [_stop_line(scene, lane, lines[index], sign_ids)]
                        if index in lines and piece is parts[-1]
                        else []
                    ),
                    E.laneletType(_lane_type(lane)),
                    *(
                        E("userBidirectional" if user == "pedestrian" else "userOneWay", user)
                        for user in users
                    ),
                    *(E.trafficSignRef(ref=str(sign_ids[plate])) for plate in piece.plates),
                    id=str(piece.lanelet),
                )
            )
    for crossing in network.crossings.values():
        bounds = _bounds(crossing.line, crossing.width, "no_marking", "no_marking")
        kinds = E.laneletType("crosswalk"), E.userBidirectional("pedestrian")
        found.append(E.lanelet(*bounds, *kinds, id=str(next(free_ids))))
    return found


# Solid where one has to stop, broken where one gives way.
_STOP_MARKINGS = {"stop": "broad_solid", "give_way": "broad_dashed"}


def _stop_line(scene: Scene, lane: Lane, line: str, sign_ids: dict[str, int]) -> Element:
    """The line across a lane's end, with the plates that ask for it."""
    s, half = lane.line.length - STYLE.stop_line_m / 2, lane.width / 2
    plates = [s.id for s in scene.signs if s.edge == lane.edge and s.code in GIVE_WAY | STOP]
    return E.stopLine(
        *(point(*lane.line.point_at(s, d)) for d in (half, -half)),
        E.lineMarking(_STOP_MARKINGS[line]),
        *(E.trafficSignRef(ref=str(sign_ids[plate])) for plate in plates),
    )


def traffic_sign(sign: SignInstance, sign_id: int) -> Element:
    """A plate; one that CommonRoad has no number for keeps the catalogue's code, which its reader calls UNKNOWN."""
    inner = E.trafficSignElement(E.trafficSignID(SIGN_NUMBERS.get(sign.code, sign.code)))
    if sign.value is not None:
        inner.append(E.additionalValue(number(sign.value * _MPS_PER_KMH)))
    return E.trafficSign(inner, E.position(point(sign.x, sign.y)), E.virtual("false"), id=str(sign_id))


def _successors(network: RoadNetwork, cut: Mapping[int, tuple[Piece, ...]]) -> dict[int, list[int]]:
    """By lanelet: where one can drive on, through what lies inside a junction."""
    after: dict[int, list[int]] = {piece.lanelet: [] for parts in cut.values() for piece in parts}
    for parts in cut.values():
        for one, other in pairwise(parts):
            after[one.lanelet].append(other.lanelet)
    for c in network.connections:
        chain = [cut[index] for index in (c.from_lane, *c.via, c.to_lane) if index in cut]
        for before, behind in pairwise(chain):
            if behind[0].lanelet not in after[before[-1].lanelet]:
                after[before[-1].lanelet].append(behind[0].lanelet)
    return after


def _bounds(line: Polyline, width: float, left: str, right: str) -> list[Element]:
    """Both bounds with their markings."""
    return [
        E(tag, *points(line.beside(d)), E.lineMarking(marking))
        for tag, d, marking in (("leftBound", width / 2, left), ("rightBound", -width / 2, right))
    ]


def _marking(lane: Lane, neighbour: int, known: Container[int]) -> str:
    if lane.internal:
        return "no_marking"
    return "dashed" if neighbour in known else "solid"


def _lane_type(lane: Lane) -> str:
    if lane.internal:
        return "intersection"
    if lane.permits("passenger"):
        return "urban"
    if lane.permits("bus"):
        return "busLane"
    return "bicycleLane" if lane.permits("bicycle") else "sidewalk"
