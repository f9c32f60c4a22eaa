"""A crop's lanes and plates as CommonRoad lanelets and traffic signs (format 2020a). Units: m, rad."""

from __future__ import annotations

from itertools import pairwise

from lxml import etree

from tsbench.geometry.polyline import Array, Polyline
from tsbench.roads.network import Crossing, Lane, RoadNetwork
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


def number(value: float) -> str:
    """A decimal as CommonRoad's schema takes it: no exponent."""
    return f"{value:.4f}"


def add_text(parent: etree._Element, tag: str, text: str) -> None:
    """A child that holds a text."""
    etree.SubElement(parent, tag).text = text


def add_points(parent: etree._Element, points: Array) -> None:
    """Children <point> of (n, 2) points."""
    for x, y in points.tolist():
        point = etree.SubElement(parent, "point")
        add_text(point, "x", number(x))
        add_text(point, "y", number(y))


def lane_ids(network: RoadNetwork) -> dict[int, int]:
    """Lanelet ids, positive, by lane index; lanes without extent have none."""
    return {lane.index: lane.index + 1 for lane in network.lanes if lane.line.length >= _SHORTEST_M}


def add_lanelets(root: etree._Element, scene: Scene, sign_ids: dict[str, int], next_id: int) -> int:
    """All lanes and crossings; returns the next free id."""
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
    for index, lanelet_id in ids.items():
        lane = network.lanes[index]
        element = etree.SubElement(root, "lanelet", id=str(lanelet_id))
        _add_bound(element, "leftBound", lane.line.beside(lane.width / 2), _marking(lane, lane.left, ids))
        _add_bound(element, "rightBound", lane.line.beside(-lane.width / 2), _marking(lane, lane.right, ids))
        for tag, others in (("predecessor", before[index]), ("successor", after[index])):
            for other in others:
                etree.SubElement(element, tag, ref=str(ids[other]))
        for tag, other in (("adjacentLeft", lane.left), ("adjacentRight", lane.right)):
            if other in ids:
                etree.SubElement(element, tag, ref=str(ids[other]), drivingDir="same")
        add_text(element, "laneletType", _lane_type(lane))
        for vclass, user in _USERS:
            if lane.permits(vclass):
                add_text(element, "userBidirectional" if user == "pedestrian" else "userOneWay", user)
        for plate in plates.get(index, ()):
            etree.SubElement(element, "trafficSignRef", ref=str(plate))
    for crossing in network.crossings.values():
        _add_crossing(root, crossing, next_id)
        next_id += 1
    return next_id


def sign_lanes(network: RoadNetwork, sign: SignInstance) -> list[int]:
    """Lanes that a plate addresses."""
    lanes = network.edges[sign.edge].lanes
    return list(lanes) if sign.lane < 0 else [lanes[sign.lane]]


def add_sign(root: etree._Element, sign: SignInstance, sign_id: int) -> None:
    """A plate; one that CommonRoad has no number for keeps the catalogue's code, which its reader calls UNKNOWN."""
    element = etree.SubElement(root, "trafficSign", id=str(sign_id))
    inner = etree.SubElement(element, "trafficSignElement")
    add_text(inner, "trafficSignID", SIGN_NUMBERS.get(sign.code, sign.code))
    if sign.value is not None:
        add_text(inner, "additionalValue", number(sign.value * _MPS_PER_KMH))
    position = etree.SubElement(element, "position")
    point = etree.SubElement(position, "point")
    add_text(point, "x", number(sign.x))
    add_text(point, "y", number(sign.y))
    add_text(element, "virtual", "false")


def _successors(network: RoadNetwork, ids: dict[int, int]) -> dict[int, list[int]]:
    """By lane: where one can drive on, through what lies inside a junction."""
    after: dict[int, list[int]] = {index: [] for index in ids}
    for c in network.connections:
        chain = [index for index in (c.from_lane, *c.via, c.to_lane) if index in ids]
        for one, other in pairwise(chain):
            if other not in after[one]:
                after[one].append(other)
    return after


def _add_bound(lanelet: etree._Element, tag: str, points: Array, marking: str) -> None:
    bound = etree.SubElement(lanelet, tag)
    add_points(bound, points)
    add_text(bound, "lineMarking", marking)


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


def _add_crossing(root: etree._Element, crossing: Crossing, lanelet_id: int) -> None:
    line: Polyline = crossing.line
    element = etree.SubElement(root, "lanelet", id=str(lanelet_id))
    _add_bound(element, "leftBound", line.beside(crossing.width / 2), "no_marking")
    _add_bound(element, "rightBound", line.beside(-crossing.width / 2), "no_marking")
    add_text(element, "laneletType", "crosswalk")
    add_text(element, "userBidirectional", "pedestrian")
