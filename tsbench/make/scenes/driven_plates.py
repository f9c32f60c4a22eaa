"""Does a vehicle's way break a plate that binds it? Units: m, km/h.

Left out is what only a drive shows: a stop, a gap, the ego's speed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise
from types import MappingProxyType

from tsbench.make.scenes.placed_plates import PlacedPlates, PlateHere, RoutedVehicle
from tsbench.roads.network import RoadNetwork
from tsbench.signs.annotations import TARGET, SignInstance
from tsbench.sim.scene_file import EGO_ID

_KMH = 3.6
# An end so near to the start of an edge leaves none of it in the zone.
_AT_START_M = 1.0


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
