"""The vehicles of a scene with their ways, as its file has them. Units: m, m/s."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from lxml import etree

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
    """All vehicles, in the order of the file, stand-ins of obstacles left out; the ego on its lawful way."""
    root = read_additional(scene.additional.path, scene.additional.content)
    types = {str(t.get("id")): t for t in root.iterfind("vType")}
    still = {o.id for o in scene.obstacles}
    return tuple(_vehicles(scene, root, types, still))


def _vehicles(
    scene: Scene, root: etree._Element, types: dict[str, etree._Element], still: set[str]
) -> Iterator[RoutedVehicle]:
    for element in root.iterfind("vehicle"):
        name, route = str(element.get("id")), element.find("route")
        if name in still or route is None:
            continue
        edges = tuple(str(route.get("edges")).split())
        if name == EGO_ID:
            edges = scene.compliant_hint or scene.route_hint
        kind = types[str(element.get("type"))]
        lane = scene.network.edge_lanes(edges[0])[0]
        place = element.get("departPos", "base")
        first = 0.0 if place == "base" else float(place) * lane.line.length / lane.length
        yield RoutedVehicle(
            id=name, vclass=kind.get("vClass", "passenger"), edges=edges, first_s=first,
            speed=float(kind.get("maxSpeed", "inf")),
        )  # fmt: skip
