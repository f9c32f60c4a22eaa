"""A crop's lanes, intersections and plates as CommonRoad lanelets and traffic signs (format 2020a). Units: m, rad.

Plates of CommonRoad hold for whole lanelets, so lanes are cut (`pieces`) where a speed begins or ends to hold.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from lxml.builder import E

from tsbench.geometry.polyline import Array, Polyline
from tsbench.report.drawing.canvas import STYLE
from tsbench.report.drawing.road_shapes import stop_lines
from tsbench.roads.network import Lane, RoadNetwork
from tsbench.signs.annotations import SignInstance
from tsbench.signs.rule_kinds import ReservedLaneParams, ZoneParams
from tsbench.sim.main_road import GIVE_WAY, STOP
from tsbench.sim.scene import Scene

# An element; lxml's builder has no types.
Element = Any


def number(value: float) -> str:
    """A decimal as CommonRoad's schema takes it: no exponent."""
    return f"{value:.4f}"


def point(x: float, y: float) -> Element:
    return E.point(E.x(number(x)), E.y(number(y)))


def points(line: Array) -> list[Element]:
    """Elements of (n, 2) points."""
    return [point(x, y) for x, y in line.tolist()]


# Internal lanes where two roads only touch have no extent, and no direction either.
SHORTEST_M = 0.05
# Plates that ask a speed from their line on; all others mean the whole road that they stand at.
_SPEEDS = frozenset({"3.24", "4.6", "5.21", "5.31"})


@dataclass(frozen=True)
class Piece:
    """A lanelet: its id, the part of its lane from `begins` to `ends`, and the plates (ids in the scene) held there."""

    lanelet: int
    begins: float
    ends: float
    plates: tuple[str, ...]


def lane_ids(network: RoadNetwork) -> dict[int, int]:
    """The lanelet at each lane's end, positive, by lane index; lanes without extent have none."""
    return {lane.index: lane.index + 1 for lane in network.lanes if lane.line.length >= SHORTEST_M}


def pieces(scene: Scene, free_ids: Iterator[int]) -> dict[int, tuple[Piece, ...]]:
    """Each lane's lanelets along it, by lane index. free_ids: for all but each lane's last, which `lane_ids` has."""
    network, found = scene.network, {}
    stretches: dict[int, list[tuple[str, float, float]]] = {}
    for sign in scene.signs:
        for index, begins, ends in _holds(network, sign, scene.signs):
            stretches.setdefault(index, []).append((sign.id, begins, ends))
    for index, lanelet in lane_ids(network).items():
        length = network.lanes[index].line.length
        held = stretches.get(index, [])
        marks = _apart([at for _, *both in held for at in both], length)
        bounds = [0.0, *marks, length]
        ids = [*(next(free_ids) for _ in marks), lanelet]
        found[index] = tuple(
            Piece(one, begins, ends, tuple(sign for sign, a, b in held if a < (begins + ends) / 2 < b))
            for one, (begins, ends) in zip(ids, pairwise(bounds), strict=True)
        )
    return found


def _apart(marks: list[float], length: float) -> list[float]:
    """The marks inside a lane in their order, without what would leave a lanelet without extent."""
    kept: list[float] = []
    for mark in sorted(marks):
        if mark - (kept[-1] if kept else 0.0) > SHORTEST_M and mark < length - SHORTEST_M:
            kept.append(mark)
    return kept


def _holds(
    network: RoadNetwork, sign: SignInstance, signs: tuple[SignInstance, ...]
) -> Iterator[tuple[int, float, float]]:
    """Lane, begin and end of each stretch for which a plate holds."""
    if sign.code not in _SPEEDS:
        for index in _lanes(network, sign.edge, sign.lane):
            yield index, 0.0, network.lanes[index].line.length
        return
    zone = isinstance(sign.params, ZoneParams) and not isinstance(sign.params, ReservedLaneParams)
    edges = sign.params_as(ZoneParams).zone_edges if zone else (sign.edge,)
    last = next((plate for plate in signs if plate.ends == sign.id), None)
    for edge in edges:
        begins = sign.position_m if edge == sign.edge else 0.0
        ends = last.position_m if last is not None and last.edge == edge else math.inf
        for index in _lanes(network, edge, sign.lane):
            length = network.lanes[index].line.length
            # A plate at the very end of its road belongs to that road.
            yield index, begins if begins < length - SHORTEST_M else 0.0, min(ends, length)
        if math.isfinite(ends):
            return


def _lanes(network: RoadNetwork, edge: str, lane: int) -> tuple[int, ...]:
    lanes = network.edges[edge].lanes
    return lanes if lane < 0 or lane >= len(lanes) else (lanes[lane],)


# Two roads meet everywhere where a street has another name; a junction has three arms.
_LEAST_ARMS = 3
_SUCCESSORS = {"r": "Right", "R": "Right", "s": "Straight", "l": "Left", "L": "Left"}
_ORDER = ("Right", "Straight", "Left")
# Bounds of both directions that are one line: so far from each other at most, at this many places.
_ONE_LINE_M, _PLACES = 0.6, 8


def intersections(
    network: RoadNetwork, cut: Mapping[int, tuple[Piece, ...]], free_ids: Iterator[int]
) -> Iterator[Element]:
    """Every junction of three arms or more: of each arm the lanelets that lead in, and where they lead by turns.

    cut: by lane index. free_ids: for intersections and their arms. A turn back has no place in the format.
    """
    for junction in sorted(network.junctions):
        edges = [e for e in network.edges.values() if not e.internal and junction in (e.source, e.target)]
        driven = [e for e in edges if any(network.lanes[i].permits("passenger") for i in e.lanes)]
        if len({e.source if e.target == junction else e.target for e in driven}) < _LEAST_ARMS:
            continue
        arms = [
            E.incoming(*parts, id=str(next(free_ids)))
            for edge in driven
            if edge.target == junction and (parts := _arm(network, edge.lanes, cut))
        ]
        if arms:
            yield E.intersection(*arms, id=str(next(free_ids)))


def _arm(network: RoadNetwork, lanes: tuple[int, ...], cut: Mapping[int, tuple[Piece, ...]]) -> list[Element]:
    """Lanelets of an arm, and those that follow on them, right to left; empty where none leads on."""
    leading, found = [], {name: set[int]() for name in _ORDER}
    for index in lanes:
        links = [c for c in network.outgoing[index] if c.direction in _SUCCESSORS]
        if index in cut and links:
            leading.append(cut[index][-1].lanelet)
        for c in links:
            after = next((i for i in (*c.via, c.to_lane) if i in cut), None)
            if after is not None:
                found[_SUCCESSORS[c.direction]].add(cut[after][0].lanelet)
    parts = [E.incomingLanelet(ref=str(ref)) for ref in leading]
    for name, refs in found.items():
        parts += [E(f"successors{name}", ref=str(ref)) for ref in sorted(refs)] if leading else []
    return parts


def opposite_lanes(network: RoadNetwork) -> dict[int, int]:
    """By index of an innermost lane: the innermost lane of the other direction, where both share a bound."""
    by_ends = {(e.source, e.target): e for e in network.edges.values() if not e.internal}
    found = {}
    for (source, target), edge in by_ends.items():
        back = by_ends.get((target, source))
        if back is None:
            continue
        lane, other = (network.lanes[e.lanes[-1]] for e in (edge, back))
        ours, theirs = (_inner_bound(one, network.to_kerb) for one in (lane, other))
        if np.hypot(*(ours - theirs[::-1]).T).max() <= _ONE_LINE_M:
            found[lane.index] = other.index
    return found


def _inner_bound(lane: Lane, kerb: float) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Places on the bound away from the kerb, evenly along the lane."""
    share = np.linspace(0.0, lane.line.length, _PLACES).tolist()
    return np.array([lane.line.point_at(s, -kerb * lane.width / 2) for s in share])


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
        marks = ["no_marking" if lane.internal else "dashed" if other in cut else "solid" for _, other in sides]
        users = [user for vclass, user in _USERS if lane.permits(vclass)]
        for k, piece in enumerate(parts):
            line = lane.line if len(parts) == 1 else lane.line.slice(piece.begins, piece.ends)
            found.append(
                E.lanelet(
                    *_bounds(line, lane.width, *marks),
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
                    *(E("userBidirectional" if user == "pedestrian" else "userOneWay", user) for user in users),
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


def _lane_type(lane: Lane) -> str:
    if lane.internal:
        return "intersection"
    if lane.permits("passenger"):
        return "urban"
    if lane.permits("bus"):
        return "busLane"
    return "bicycleLane" if lane.permits("bicycle") else "sidewalk"


# Numbers that CommonRoad gives to what our signs mean. It reads 209-10 as "turn right" and 220-20 as "one-way to the
# left", where the German catalogue has it the other way round: so these follow its names, not the catalogue.
SIGN_NUMBERS = {
    "2.1": "306", "2.3.1": "301", "2.3.2": "301", "2.3.3": "301", "2.4": "205", "2.5": "206", "3.1": "267",
    "3.2": "250", "3.24": "274", "3.25": "278", "4.1.1": "209-30", "4.1.2": "209-10", "4.1.3": "209-20",
    "4.2.1": "222-20", "4.2.2": "222-10", "4.3": "215", "4.6": "275", "5.7.1": "220-10", "5.7.2": "220-20",
    "5.14.1": "245", "5.14.2": "237", "5.19": "350", "5.21": "325.1", "5.22": "325.2", "5.31": "274.1",
    "5.32": "274.2",
}  # fmt: skip
