"""Background traffic of a scene: drivers drawn from the nuPlan figures, SUMO vehicles, their routes and departures.

Cars stand on every lane at the asked spacing when the episode begins; later vehicles come from a dry run in SUMO
(`scene_files`). With them stand SUMO's elements for all that moves: the ego, convoy, pedestrians, obstacles' stand-ins.
Source: docs/simulation.md, "Traffic". Units: m, s, m/s.
"""

from __future__ import annotations

import gzip
import math
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree

from tsbench.core.files import write_atomic
from tsbench.geometry.elementary import STRAIGHT
from tsbench.roads.lane_graph import LaneGraph, Turn
from tsbench.roads.network import Lane, RoadNetwork
from tsbench.sim.ego import MAX_ACCEL_MPS2, MAX_DECEL_MPS2, MAX_SPEED_MPS
from tsbench.sim.nuplan import quantile_speed, statistics
from tsbench.sim.scene import EgoStart, Obstacle
from tsbench.sim.scene_file import EGO_ID
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M

DRIVERS_PER_DRAW = 12
# Bodies by nuPlan's size classes: length, width in m.
BODIES = {"s": (3.7, 1.65), "m": (4.5, 1.85), "l": (5.3, 2.0), "xl": (8.5, 2.4)}


# The hardest braking of a vehicle: with SUMO's own 9 m/s2, a car that creeps stops dead for whatever is ahead of it.
_HARDEST_BRAKE_MPS2 = 4.5
CLEAR_BEHIND_M = 40.0
CLEAR_BESIDE_M = 12.0
CLEAR_AHEAD_M = 20.0
CLEAR_AHEAD_S = 3.0
_STRAIGHT_ON = 4.0
_MAX_EDGES = 40


@dataclass(frozen=True, slots=True)
class Driver:
    """One IDM driver: desired speed (m/s), a, b (m/s2), headway (s), standstill gap (m), body length and width (m)."""

    speed: float
    accel: float
    decel: float
    headway: float
    gap: float
    length: float
    width: float


def _lognormal(rng: np.random.Generator, median: float, mean: float, low: float, high: float) -> float:
    sigma = math.sqrt(2.0 * math.log(mean / median))
    return float(np.clip(median * math.exp(sigma * rng.standard_normal()), low, high))


def draw_driver(rng: np.random.Generator) -> Driver:
    """One driver.

    Free-flow speed: the upper three fifths of moving speeds, because the lower ones are cars held up by others.
    IDM's a and b are *largest* comfortable values: twice the published typical ones. The headway is what the published
    median gap is at the published median speed.
    """
    stats = statistics()
    acc, dec = stats["acceleration_mps2"], stats["deceleration_mps2"]
    following = stats["following_distance_m"]
    gap = float(rng.uniform(1.5, 3.0))
    headway = (float(following["p50"]) - gap) / float(stats["speed_mps"]["p50"])
    spread = float(following["mean"]) / float(following["p50"])
    sizes = stats["size_mix"]
    size = str(rng.choice(list(sizes), p=np.array(list(sizes.values())) / sum(sizes.values())))
    length, width = BODIES[size]
    return Driver(
        speed=quantile_speed(float(rng.uniform(0.4, 1.0))),
        accel=_lognormal(rng, 2 * float(acc["p50"]), 2 * float(acc["mean"]), 0.8, 2.8),
        decel=_lognormal(rng, 2 * float(dec["p50"]), 2 * float(dec["mean"]), 1.0, 3.5),
        headway=_lognormal(rng, headway, headway * spread, 0.8, 3.0),
        gap=gap,
        length=length,
        width=width,
    )


def draw_drivers(rng: np.random.Generator) -> tuple[Driver, ...]:
    return tuple(draw_driver(rng) for _ in range(DRIVERS_PER_DRAW))


@dataclass(frozen=True, slots=True)
class Car:
    """One background vehicle. `position` is the front's place (None: enters at the start of its first edge)."""

    id: str
    driver: int
    depart: float
    edges: tuple[str, ...]
    lane: int
    position: float | None


@dataclass(frozen=True)
class TrafficRequest:
    """What is asked: cars per lane-km, drivers to draw from, the ego's start, and where nobody is put or sent.

    avoid_turns: what the plates forbid. quiet_edges: edges kept free at the start (the convoy's).
    blocked: (lane id, from, to) stretches where no car stands at first. platoons: edges on which cars enter in
    platoons, as from signals upstream, so that who gives way finds a gap in time. closed_edges: where nobody stands or
    enters; that nobody turns into them either is a matter of `avoid_turns`. quiet_s: until then nobody enters anywhere.
    """

    cars_per_lane_km: float
    drivers: tuple[Driver, ...]
    start: EgoStart
    avoid_turns: AbstractSet[Turn]
    quiet_edges: AbstractSet[str]
    blocked: tuple[tuple[str, float, float], ...]
    platoons: AbstractSet[str]
    closed_edges: AbstractSet[str] = frozenset()
    quiet_s: float = 0.0

    def allows(self, lane: Lane, s: float) -> bool:
        """May a car stand here when the episode begins?"""
        return lane.edge not in self.quiet_edges and not any(
            lane.id == name and a <= s <= b for name, a, b in self.blocked
        )


class Router:
    """Random ways through a crop, straight on preferred, never by a forbidden turn."""

    def __init__(self, graph: LaneGraph, avoid: AbstractSet[Turn]) -> None:
        self.graph, self.avoid = graph, avoid

    def walk(self, edge: str, rng: np.random.Generator) -> tuple[str, ...]:
        """Edges from `edge` to where the crop ends; no edge twice."""
        route = [edge]
        while len(route) < _MAX_EDGES:
            options = [
                e for e in self.graph.successors(route[-1]) if (route[-1], e) not in self.avoid and e not in route
            ]
            if not options:
                break
            weight = np.array([_STRAIGHT_ON if self.graph.turn(route[-1], e) == STRAIGHT else 1.0 for e in options])
            route.append(options[int(rng.choice(len(options), p=weight / weight.sum()))])
        return tuple(route)


def avoidable(turns: AbstractSet[Turn], graph: LaneGraph, avoided: AbstractSet[Turn]) -> frozenset[Turn]:
    """Those of the turns that cars can leave alone beside the avoided ones: another way on is left."""
    found: set[Turn] = set()
    for turn in sorted(turns):
        ways = {(turn[0], e) for e in graph.successors(turn[0])} - avoided - found
        if ways - {turn}:
            found.add(turn)
    return frozenset(found)


def driving_lanes(network: RoadNetwork, closed: AbstractSet[str] = frozenset()) -> list[Lane]:
    """Ordinary lanes for cars but those of closed edges, in the order of the network."""
    return [
        lane for lane in network.lanes if not lane.internal and lane.permits("passenger") and lane.edge not in closed
    ]


def lane_km(network: RoadNetwork, closed: AbstractSet[str] = frozenset()) -> float:
    """Kilometres of ordinary lanes for cars but those of closed edges."""
    return sum(lane.line.length for lane in driving_lanes(network, closed)) / 1000.0


def _lane_on(graph: LaneGraph, lane: Lane, edges: tuple[str, ...]) -> bool:
    """Can a route be driven from this lane of its first edge without a lane change?"""
    if len(edges) == 1:
        return True
    return any(c.from_lane == lane.index for c in graph.connections(edges[0], edges[1]))


def _clear_of_ego(lane: Lane, s: float, start: EgoStart, network: RoadNetwork) -> bool:
    ego_lane = network.lane(start.lane)
    if lane.edge != ego_lane.edge:
        return True
    ahead = s - start.s
    if lane.id != ego_lane.id:
        return abs(ahead) > CLEAR_BESIDE_M
    return ahead < -CLEAR_BEHIND_M or ahead > max(CLEAR_AHEAD_M, CLEAR_AHEAD_S * start.speed)


def standing_cars(network: RoadNetwork, graph: LaneGraph, ask: TrafficRequest, rng: np.random.Generator) -> list[Car]:
    """The cars that are there when the episode begins, at the asked spacing on every lane."""
    router = Router(graph, ask.avoid_turns)
    spacing = 1000.0 / ask.cars_per_lane_km
    cars: list[Car] = []
    for lane in driving_lanes(network, ask.closed_edges):
        s = float(rng.uniform(0.0, spacing))
        while s < lane.line.length - 2.0:
            if s > 6.0 and ask.allows(lane, s) and _clear_of_ego(lane, s, ask.start, network):
                edges = router.walk(lane.edge, rng)
                cars.append(make_car(cars, rng, 0.0, edges, lane, s, ask, graph))
            s += max(spacing * float(rng.uniform(0.75, 1.25)), 9.0)
    return cars


def make_car(
    cars: list[Car],
    rng: np.random.Generator,
    depart: float,
    edges: tuple[str, ...],
    lane: Lane,
    position: float | None,
    ask: TrafficRequest,
    graph: LaneGraph,
) -> Car:
    """The next car of a scene: it keeps to a way that its lane leads to, because crops are short for lane changes."""
    if not _lane_on(graph, lane, edges):
        onward = [c for c in graph.network.outgoing[lane.index] if graph.network.lanes[c.to_lane].permits("passenger")]
        usable = [c for c in onward if (lane.edge, graph.network.lanes[c.to_lane].edge) not in ask.avoid_turns]
        if usable:
            target = graph.network.lanes[usable[int(rng.integers(len(usable)))].to_lane].edge
            edges = (lane.edge, *Router(graph, ask.avoid_turns).walk(target, rng))
    driver = int(rng.integers(len(ask.drivers)))
    return Car(f"bg_{len(cars):03d}", driver, depart, edges, lane.order, position)


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
