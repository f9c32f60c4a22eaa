"""The vehicles of a scene with their ways, as its file has them. Units: m, m/s."""

from __future__ import annotations

from dataclasses import dataclass

from lxml import etree

from tsbench.roads.network import RoadNetwork
from tsbench.sim.scene import Scene
from tsbench.sim.scene_file import EGO_ID, read_additional


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
