"""Plates at their places: roads, other plates, obstacles and vehicles around them; vehicles whose way breaks a plate.

Of breaking a plate left out is what only a drive shows: a stop, a gap, the ego's speed. Units: m, km/h.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType

from lxml import etree

from tsbench.geometry.elementary import LEFT, RIGHT
from tsbench.make.scenes.plate_roads import PlateRoads, WayOn
from tsbench.roads.network import RoadNetwork
from tsbench.signs.annotations import TARGET, SignInstance
from tsbench.signs.catalog import Catalog, Sign
from tsbench.sim.scene import Obstacle, Scene
from tsbench.sim.scene_file import EGO_ID, read_additional

CLOSED = "3.2"
CLOSING = ("3.1", CLOSED)
ONE_WAY = ("5.7.1", "5.7.2")
_KMH = 3.6
# An end so near to the start of an edge leaves none of it in the zone.
_AT_START_M = 1.0


@dataclass(frozen=True, slots=True)
class RoutedVehicle:
    """A vehicle and its way. first_s: its front along the first edge at the start. speed: its driver's most."""

    id: str
    vclass: str
    edges: tuple[str, ...]
    first_s: float
    speed: float

    def passes(self, *, edge: str, s: float) -> bool:
        """Does it come to a place along an edge from before it?"""
        return edge in self.edges and (edge != self.edges[0] or edge in self.edges[1:] or self.first_s < s)


def scene_vehicles(scene: Scene) -> tuple[RoutedVehicle, ...]:
    """All vehicles of a scene, in the order of the file, the ego on its lawful way."""
    root = read_additional(scene.additional.path, scene.additional.content)
    return routed_vehicles(root=root, network=scene.network, lawful=scene.compliant_hint or scene.route_hint)


def routed_vehicles(
    *, root: etree._Element, network: RoadNetwork, lawful: tuple[str, ...]
) -> tuple[RoutedVehicle, ...]:
    """The vehicles of an additional file, stand-ins of obstacles left out. lawful: the ego's way."""
    types = {str(t.get("id")): t for t in root.iterfind("vType")}
    still = {p.get("id") for p in root.iterfind("poly") if p.get("type") == "obstacle"}
    found = []
    for element in root.iterfind("vehicle"):
        name, route = str(element.get("id")), element.find("route")
        if name in still or route is None:
            continue
        edges = lawful if name == EGO_ID else tuple(str(route.get("edges")).split())
        kind = types[str(element.get("type"))]
        lane = network.edge_lanes(edges[0])[0]
        place = element.get("departPos", "base")
        first = 0.0 if place == "base" else float(place) * lane.line.length / lane.length
        vclass, speed = kind.get("vClass", "passenger"), float(kind.get("maxSpeed", "inf"))
        found.append(RoutedVehicle(id=name, vclass=vclass, edges=edges, first_s=first, speed=speed))
    return tuple(found)


@dataclass(frozen=True)
class PlacedPlates:
    """All that decides where plates can stand: roads, plates, obstacles and vehicles of one scene."""

    catalog: Catalog
    roads: PlateRoads
    plates: tuple[SignInstance, ...]
    obstacles: tuple[Obstacle, ...]
    vehicles: tuple[RoutedVehicle, ...]

    @cached_property
    def at_line(self) -> Mapping[str, tuple[PlateHere, ...]]:
        """By edge that ends at a junction: the plates on the road that it ends."""
        found: dict[str, tuple[PlateHere, ...]] = {}
        for here in (PlateHere(self, plate) for plate in self.plates):
            if here.ahead.junction:
                found[here.ahead.edges[-1]] = (*found.get(here.ahead.edges[-1], ()), here)
        return found

    @cached_property
    def against(self) -> Mapping[str, str]:
        """Edges against the direction of the road across a target of one-way traffic, with the target's code.

        That road has lanes both ways in both halves: its plates alone say its direction.
        """
        found: dict[str, str] = {}
        roads, plates = self.roads, (here for plates in self.at_line.values() for here in plates)
        for here in plates:
            if here.plate.role == TARGET and here.plate.code in ONE_WAY:
                for edge in here.across[1]:
                    ahead = roads.approach(edge=edge, s=roads.length(edge))
                    road = (*ahead.edges, *roads.back(edge=edge, s=0.0).edges)
                    found.update(dict.fromkeys(road, here.plate.code))
        return found


@dataclass(frozen=True)
class PlateHere:
    """One plate at its place."""

    scene: PlacedPlates
    plate: SignInstance

    @cached_property
    def sign(self) -> Sign:
        return self.scene.catalog.sign(self.plate.code)

    @cached_property
    def ahead(self) -> WayOn:
        """The way on to the next junction."""
        return self.scene.roads.approach(edge=self.plate.edge, s=self.plate.position_m)

    @cached_property
    def across(self) -> tuple[frozenset[str], frozenset[str]]:
        """Of a plate of one-way traffic: edges of the crossing road in its direction behind it, and against it."""
        allowed = self.sign.rule.options["allowed"]
        side, other = (RIGHT, LEFT) if RIGHT in allowed else (LEFT, RIGHT)
        across = self.scene.roads.across(self.ahead.edges[-1])
        return across[side][0], across[other][0] | across[side][1]

    def is_before(self, other: SignInstance) -> bool:
        """Does another plate stand farther on, before the next junction?"""
        on = other.edge in self.ahead.edges
        return on and (other.edge != self.plate.edge or other.position_m > self.plate.position_m)

    def closing(self, edge: str) -> str:
        """Code of the plate that closes an edge at its mouth, or makes its road one-way against it; "": none does."""
        at_mouth = (p.code for p in self.scene.plates if p.edge == edge and p.code in CLOSING)
        return next(at_mouth, self.scene.against.get(edge, ""))

    def lets(self, approach: str, edge: str) -> bool:
        """Do all plates of ways on at an approach permit the turn from it onto an edge?"""
        return all(plate.permits(approach, edge) for plate in self.scene.at_line.get(approach, ()))

    def permits(self, approach: str, edge: str) -> bool:
        """Does this plate permit the turn from its approach onto an edge?"""
        turns = self.sign.rule.options.get("allowed")
        return turns is None or self.scene.roads.graph.turn(approach, edge) in turns

    @property
    def bound(self) -> Iterator[RoutedVehicle]:
        """Vehicles that must not be where the plate forbids it: all, but for the ego where the plate is the target."""
        return (v for v in self.scene.vehicles if v.id != EGO_ID or self.plate.role != TARGET)

    def at_target(self, codes: Sequence[str]) -> bool:
        """Does the plate stand before the junction of a target with one of these codes?"""
        roads = self.scene.roads
        return any(
            roads.approach(edge=p.edge, s=p.position_m).junction == self.ahead.junction
            for p in self.scene.plates
            if p.role == TARGET and p.code in codes
        )

    @property
    def farthest(self) -> float:
        """How far before its line, crossing or obstacle the sign may stand."""
        return self.sign.placement.distance_m[1] + self.scene.catalog.distances.slack_m


def broken_plates(scene: PlacedPlates, vehicle: RoutedVehicle) -> tuple[tuple[SignInstance, str], ...]:
    """Each plate of a scene that binds a vehicle and that its way breaks, with the reason.

    Whether the ego keeps the target is what its drive is judged by, and is not asked here.
    """
    found = []
    for plate in scene.plates:
        if vehicle.id == EGO_ID and plate.role == TARGET:
            continue
        asks = _BROKEN.get(scene.catalog.sign(plate.code).rule.name)
        if asks is not None and vehicle.passes(edge=plate.edge, s=plate.position_m):
            why = asks(PlateHere(scene, plate), vehicle)
            found += [(plate, why)] if why else []
    return tuple(found)


def _drives_past(here: PlateHere, vehicle: RoutedVehicle) -> str:  # noqa: ARG001
    return "drives past it"


def _turns(here: PlateHere, vehicle: RoutedVehicle) -> str:
    approach, graph = here.ahead.edges[-1], here.scene.roads.graph
    for a, b in pairwise(vehicle.edges):
        if here.ahead.junction and a == approach:
            turn = graph.turn(a, b)
            if turn not in here.sign.rule.options["allowed"]:
                return f"goes {turn.replace('_', '-')}"
    return ""


def _speeds(here: PlateHere, vehicle: RoutedVehicle) -> str:
    limit, rule = here.sign.effective_value(here.plate.value), here.sign.rule
    if here.sign.is_end or limit is None or vehicle.id == EGO_ID:
        return ""
    network = here.scene.roads.network
    fastest = max((_drives(network, e, vehicle) for e in _zone(here, vehicle)), default=0.0)
    return f"drives {fastest:.0f} km/h" if fastest > limit + rule.thresholds["tolerance_kmh"] else ""


def _crawls(here: PlateHere, vehicle: RoutedVehicle) -> str:
    limit, rule = here.plate.posted, here.sign.rule
    most = vehicle.speed * _KMH
    return f"drives {most:.0f} km/h at most" if most < limit - rule.thresholds["tolerance_kmh"] else ""


def _shares(here: PlateHere, vehicle: RoutedVehicle) -> str:
    if vehicle.vclass == here.sign.rule.option("users") or here.sign.rule.option("users_direction") != "same":
        return ""
    lane = here.scene.roads.network.edge_lanes(here.plate.edge)[max(here.plate.lane, 0)]
    return "its lane is open to it" if lane.permits(vehicle.vclass) else ""


def _zone(here: PlateHere, vehicle: RoutedVehicle) -> list[str]:
    """Edges of a vehicle's way on which a limit holds, the plate's own first."""
    sign, plates, roads = here.sign, here.scene.plates, here.scene.roads
    over = {sign.code, *(code for code in sign.rule.ended_by)}
    start = vehicle.edges.index(here.plate.edge)
    zone: list[str] = []
    for name in vehicle.edges[start:]:
        first = here.plate.position_m if not zone else -1.0
        ends = [p.position_m for p in plates if p.edge == name and p.code in over and p.position_m > first]
        if zone and ends and min(ends) < _AT_START_M:
            break
        zone.append(name)
        if ends:
            break
        if sign.rule.ends_at_junction and roads.is_junction(roads.network.edges[name].target):
            break
    return zone


def _drives(network: RoadNetwork, edge: str, vehicle: RoutedVehicle) -> float:
    """The most that a vehicle drives on an edge, km/h."""
    lanes = [lane for lane in network.edge_lanes(edge) if lane.permits(vehicle.vclass)]
    return min(vehicle.speed, max((lane.speed for lane in lanes), default=0.0)) * _KMH


# Rules that a way can break.
_BROKEN: Mapping[str, Callable[[PlateHere, RoutedVehicle], str]] = MappingProxyType(
    {
        "no_entry": _drives_past,
        "closed_road": _drives_past,
        "manoeuvre": _turns,
        "one_way_exit": _turns,
        "speed": _speeds,
        "min_speed": _crawls,
        "reserved_lane": _shares,
    }
)
