"""A crop's lanes and plates as CommonRoad lanelets and traffic signs (format 2020a). Units: m, rad."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

from lxml.builder import E

from tsbench.geometry.polyline import Array, Polyline
from tsbench.roads.network import Lane, RoadNetwork
from tsbench.signs.annotations import SignInstance
from tsbench.sim.scene import Scene

# Numbers that CommonRoad gives to what our signs mean. It reads 209-10 as "turn right" and 220-20 as "one-way to the
# left", where the German catalogue has it the other way round: so these follow its names, not the catalogue.
SIGN_NUMBERS = {
    "2.1": "306", "2.3.1": "301", "2.3.2": "301", "2.3.3": "301", "2.4": "205", "2.5": "206", "3.1": "267",
    "3.2": "250", "3.24": "274", "3.25": "278", "4.1.1": "209-30", "4.1.2": "209-10", "4.1.3": "209-20",
    "4.2.1": "222-20", "4.2.2": "222-10", "4.3": "215", "4.6": "275", "5.7.1": "220-10", "5.7.2": "220-20",
    "5.14.1": "245", "5.14.2": "237", "5.19": "350", "5.21": "325.1", "5.22": "325.2", "5.31": "274.1",
    "5.32": "274.2",
}  # fmt: skip
_MPS_PER_KMH = 1 / 3.6
# Internal lanes where two roads only touch have no extent, and no direction either.
_SHORTEST_M = 0.05
_USERS = (("passenger", "car"), ("bus", "bus"), ("bicycle", "bicycle"), ("pedestrian", "pedestrian"))


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


def lane_ids(network: RoadNetwork) -> dict[int, int]:
    """Lanelet ids, positive, by lane index; lanes without extent have none."""
    return {lane.index: lane.index + 1 for lane in network.lanes if lane.line.length >= _SHORTEST_M}


def lanelets(scene: Scene, sign_ids: dict[str, int], free_ids: Iterator[int]) -> list[Element]:
    """All lanes, and all crossings with the next free ids."""
    network, ids = scene.network, lane_ids(scene.network)
    after = _successors(network, ids)
    before: dict[int, list[int]] = {index: [] for index in ids}
    for index, following in after.items():
        for other in following:
            before[other].append(index)
    plates: dict[int, list[int]] = {}
    for sign in scene.signs:
        for index in sign_lanes(network, sign):
            plates.setdefault(index, []).append(sign_ids[sign.id])
    found = []
    for index, lanelet_id in ids.items():
        lane = network.lanes[index]
        sides = (("Left", lane.left), ("Right", lane.right))
        users = [user for vclass, user in _USERS if lane.permits(vclass)]
        found.append(
            E.lanelet(
                *_bounds(lane.line, lane.width, *(_marking(lane, other, ids) for _, other in sides)),
                *(E.predecessor(ref=str(ids[other])) for other in before[index]),
                *(E.successor(ref=str(ids[other])) for other in after[index]),
                *(
                    E(f"adjacent{side}", ref=str(ids[other]), drivingDir="same")
                    for side, other in sides
                    if other in ids
                ),
                E.laneletType(_lane_type(lane)),
                *(E("userBidirectional" if user == "pedestrian" else "userOneWay", user) for user in users),
                *(E.trafficSignRef(ref=str(plate)) for plate in plates.get(index, ())),
                id=str(lanelet_id),
            )
        )
    for crossing in network.crossings.values():
        bounds = _bounds(crossing.line, crossing.width, "no_marking", "no_marking")
        kinds = E.laneletType("crosswalk"), E.userBidirectional("pedestrian")
        found.append(E.lanelet(*bounds, *kinds, id=str(next(free_ids))))
    return found


def sign_lanes(network: RoadNetwork, sign: SignInstance) -> list[int]:
    lanes = network.edges[sign.edge].lanes
    return list(lanes) if sign.lane < 0 else [lanes[sign.lane]]


def traffic_sign(sign: SignInstance, sign_id: int) -> Element:
    """A plate; one that CommonRoad has no number for keeps the catalogue's code, which its reader calls UNKNOWN."""
    inner = E.trafficSignElement(E.trafficSignID(SIGN_NUMBERS.get(sign.code, sign.code)))
    if sign.value is not None:
        inner.append(E.additionalValue(number(sign.value * _MPS_PER_KMH)))
    return E.trafficSign(inner, E.position(point(sign.x, sign.y)), E.virtual("false"), id=str(sign_id))


def _successors(network: RoadNetwork, ids: dict[int, int]) -> dict[int, list[int]]:
    """By lane: where one can drive on, through what lies inside a junction."""
    after: dict[int, list[int]] = {index: [] for index in ids}
    for c in network.connections:
        chain = [index for index in (c.from_lane, *c.via, c.to_lane) if index in ids]
        for one, other in pairwise(chain):
            if other not in after[one]:
                after[one].append(other)
    return after


def _bounds(line: Polyline, width: float, left: str, right: str) -> list[Element]:
    """Both bounds with their markings."""
    return [
        E(tag, *points(line.beside(d)), E.lineMarking(marking))
        for tag, d, marking in (("leftBound", width / 2, left), ("rightBound", -width / 2, right))
    ]


def _marking(lane: Lane, neighbour: int, ids: dict[int, int]) -> str:
    if lane.internal:
        return "no_marking"
    return "dashed" if neighbour in ids else "solid"


def _lane_type(lane: Lane) -> str:
    if lane.internal:
        return "intersection"
    if lane.permits("passenger"):
        return "urban"
    if lane.permits("bus"):
        return "busLane"
    return "bicycleLane" if lane.permits("bicycle") else "sidewalk"
