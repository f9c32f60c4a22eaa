"""SUMO elements of a scene that move: vehicle types, the ego, background cars, convoy, obstacles' stand-ins."""

from __future__ import annotations

import gzip
from collections.abc import Sequence
from pathlib import Path

from lxml import etree

from tsbench.core.files import write_atomic
from tsbench.make.scenes.traffic import Car, Driver
from tsbench.roads.network import Lane, RoadNetwork
from tsbench.sim.ego import MAX_ACCEL_MPS2, MAX_DECEL_MPS2, MAX_SPEED_MPS
from tsbench.sim.scene import EgoStart, Obstacle
from tsbench.sim.scene_file import EGO_ID
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M

# The hardest braking of a vehicle: with SUMO's own 9 m/s2, a car that creeps stops dead for whatever is ahead of it.
_HARDEST_BRAKE_MPS2 = 4.5


def _num(value: float) -> str:
    return f"{value:.3f}".rstrip("0").rstrip(".")


def _vtype(name: str, driver: Driver, color: str, vclass: str = "passenger", *, abrupt: bool = False) -> etree._Element:
    # IDM slows for a line from afar, Krauss' drivers when they must.
    model = {"carFollowModel": "Krauss", "sigma": "0"} if abrupt else {"carFollowModel": "IDM"}
    values = {
        "id": name, "vClass": vclass, **model, "speedDev": "0",
        "speedFactor": "1", "maxSpeed": _num(driver.speed), "accel": _num(driver.accel),
        "decel": _num(driver.decel), "emergencyDecel": _num(max(driver.decel, _HARDEST_BRAKE_MPS2)),
        "tau": _num(driver.headway), "minGap": _num(driver.gap),
        "length": _num(driver.length), "width": _num(driver.width), "color": color,
    }  # fmt: skip
    return etree.Element("vType", values)


def _vehicle(
    name: str, vtype: str, lane_order: int, place: float, speed: float, edges: Sequence[str]
) -> etree._Element:
    """A vehicle that is there at time 0, its front at `place` (m along its lane), whatever SUMO thinks of it."""
    vehicle = _entering(name, vtype, lane_order, _num(place), 0.0, edges, _num(speed))
    vehicle.set("insertionChecks", "none")
    return vehicle


def _entering(
    name: str, vtype: str, lane_order: int, place: str, depart: float, edges: Sequence[str], speed: str = "max"
) -> etree._Element:
    """A vehicle that comes at a time (s), by default as fast as is safe."""
    at = {"depart": _num(depart), "departLane": str(lane_order), "departPos": place, "departSpeed": speed}
    vehicle = etree.Element("vehicle", {"id": name, "type": vtype, **at})
    etree.SubElement(vehicle, "route", edges=" ".join(edges))
    return vehicle


def driver_types(drivers: Sequence[Driver]) -> list[etree._Element]:
    """One vehicle type per background driver: `bg0`, `bg1`, ..."""
    return [_vtype(f"bg{k}", d, "0.6,0.6,0.65") for k, d in enumerate(drivers)]


def background(cars: Sequence[Car]) -> list[etree._Element]:
    """Background cars with their routes, each as fast at first as is safe."""
    places = ("base" if car.position is None else _num(car.position) for car in cars)
    return [
        _entering(car.id, f"bg{car.driver}", car.lane, place, car.depart, car.edges)
        for car, place in zip(cars, places, strict=True)
    ]


def ego_elements(start: EgoStart, network: RoadNetwork, route: Sequence[str]) -> list[etree._Element]:
    """The ego's type and vehicle: SUMO's own driver in sumo-gui, the planner's in an episode."""
    lane = network.lane(start.lane)
    vtype = etree.Element(
        "vType", id="ego", vClass="passenger", carFollowModel="IDM", length=_num(EGO_LENGTH_M), width=_num(EGO_WIDTH_M),
        accel=_num(MAX_ACCEL_MPS2), decel=_num(MAX_DECEL_MPS2), maxSpeed=_num(MAX_SPEED_MPS), speedDev="0", color="red",
    )  # fmt: skip
    front = (start.s + EGO_LENGTH_M / 2) * lane.length / lane.line.length
    return [vtype, _vehicle(EGO_ID, "ego", lane.order, front, start.speed, route)]


def convoy_elements(
    drivers: Sequence[Driver],
    stands: Sequence[tuple[float, int, Sequence[str]]],
    vclass: str = "passenger",
    abrupt: bool = False,
    departs: Sequence[float] = (),
) -> list[etree._Element]:
    """The convoy that the ego meets, first one in front. stands: of each its front's place, lane order and route.

    abrupt: they brake no sooner than they must. departs: as of a ConvoySetup.
    """
    elements: list[etree._Element] = []
    for k, (driver, (place, lane_order, edges)) in enumerate(zip(drivers, stands, strict=True)):
        elements.append(_vtype(f"convoy{k}", driver, "yellow", vclass, abrupt=abrupt))
        if departs:
            elements.append(_entering(f"convoy_{k}", f"convoy{k}", lane_order, "base", departs[k], edges))
        else:
            elements.append(_vehicle(f"convoy_{k}", f"convoy{k}", lane_order, place, 0.0, edges))
    return elements


def moving_vehicle(
    name: str, driver: Driver, vclass: str, lane_order: int, place: float, edges: Sequence[str]
) -> tuple[etree._Element, etree._Element]:
    """A vehicle of the scene's own and its type: at time 0 its front is at `place`, at its cruise speed."""
    vehicle = _vehicle(name, f"{name}_type", lane_order, place, driver.speed, edges)
    return _vtype(f"{name}_type", driver, "yellow", vclass), vehicle


def walker_elements(
    name: str, size: tuple[float, float], speed: float, way: tuple[str, str], place: tuple[float, float], wait: float
) -> tuple[etree._Element, etree._Element]:
    """A pedestrian and its type, size length and width: stands at `place` (m along, m left) of the first edge of `way`.

    After `wait` seconds it walks to the end of the other; in an episode when its plan says.
    """
    vtype = etree.Element(
        "vType",
        id=f"{name}_type",
        vClass="pedestrian",
        length=_num(size[0]),
        width=_num(size[1]),
        speedDev="0",
        speedFactor="1",
        color="0.2,0.5,1",
    )
    person = etree.Element("person", id=name, type=f"{name}_type", depart="0", departPos=_num(place[0]))
    etree.SubElement(person, "stop", edge=way[0], endPos=_num(place[0]), duration=_num(wait))
    etree.SubElement(
        person, "walk", edges=" ".join(way), speed=_num(speed), departPosLat=_num(place[1]), arrivalPos="0"
    )
    return vtype, person


def waiting_elements(driver: Driver, lane: Lane, edges: Sequence[str], seconds: float) -> list[etree._Element]:
    """A car that stands a metre before the end of a lane for a while, and then drives on when it may."""
    place = lane.length - 1.0
    vehicle = _vehicle("waiting_0", "waiting0", lane.order, place, 0.0, edges)
    stretch = {"startPos": _num(place - driver.length), "endPos": _num(place)}
    etree.SubElement(vehicle, "stop", {"lane": lane.id, **stretch, "duration": _num(seconds)})
    return [_vtype("waiting0", driver, "magenta"), vehicle]


def obstacle_elements(obstacles: Sequence[Obstacle], network: RoadNetwork) -> list[etree._Element]:
    """What SUMO's traffic sees of an obstacle: a vehicle of its size that stands there for ever."""
    elements: list[etree._Element] = []
    for o in obstacles:
        lane = network.lane(o.lane)
        front = (lane.line.project(o.x, o.y)[0] + o.length / 2) * lane.length / lane.line.length
        vtype = etree.Element(
            "vType",
            id=f"{o.id}_type",
            vClass="passenger",
            length=_num(o.length),
            width=_num(o.width),
            maxSpeed="0.1",
            minGap="0.5",
            color="orange",
        )
        vehicle = _vehicle(o.id, f"{o.id}_type", lane.order, front, 0.0, (lane.edge,))
        rear = max(front - o.length, 0.0)
        etree.SubElement(vehicle, "stop", lane=lane.id, startPos=_num(rear), endPos=_num(front), duration="86400")
        elements += [vtype, vehicle]
    return elements


def write_additional(elements: Sequence[etree._Element], path: Path) -> bytes:
    """Write an additional file (.xml or .xml.gz) without times or names in its header; returns the plain content."""
    root = etree.Element("additional")
    root.append(etree.Comment(" road data (c) OpenStreetMap contributors, ODbL 1.0 "))
    root.extend(elements)
    etree.indent(root, " ")
    content: bytes = etree.tostring(root, encoding="utf-8", xml_declaration=True)
    write_atomic(path, gzip.compress(content, 9, mtime=0) if path.suffix == ".gz" else content)
    return content
