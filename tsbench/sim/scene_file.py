"""The additional file of a scene: what does not move in it, written as plain SUMO elements and read back.

Plates are `<poi type="sign">` (signs.annotations); the ego's start, the destination and the convoy's plan are points
of interest too, obstacles polygons, so that `sumo-gui -n NET -a ADDITIONAL` shows the scene as it is.
Units: m, s, m/s, rad; floats are written with repr and come back exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lxml import etree

from tsbench.core.errors import InputError
from tsbench.core.xmlfile import parse, read_plain
from tsbench.geometry.footprint import corners
from tsbench.roads.lane_graph import Destination
from tsbench.roads.network import RoadNetwork
from tsbench.signs.annotations import sign_to_poi, signs_from_additional
from tsbench.signs.catalog import Catalog
from tsbench.signs.contrast import contrast_from_additional, contrast_to_poi
from tsbench.sim.scene import ConvoyPlan, EgoStart, Obstacle, SceneFile, SceneLayout, WalkersPlan

EGO_ID = "ego"
# Vehicles that stand on a secondary arm and wait.
WAITING_ID = "waiting_0"


# Numbers of an obstacle and of a plan, by which they are written and read.
_BOX = ("x", "y", "heading", "length", "width")
_PLAN = ("ego_zone_m", "lead_time_s", "ego_cruise_mps", "ego_turn_mps")


def _poi(kind: str, x: float, y: float, color: str, params: dict[str, str]) -> etree._Element:
    return _with_params(etree.Element("poi", id=kind, type=kind, color=color, layer="90", x=repr(x), y=repr(y)), params)


def _with_params(element: etree._Element, params: dict[str, str]) -> etree._Element:
    for key, value in params.items():
        etree.SubElement(element, "param", key=key, value=value)
    return element


def layout_elements(layout: SceneLayout, network: RoadNetwork) -> list[etree._Element]:
    """The layout as SUMO elements, plates first."""
    elements = [sign_to_poi(sign) for sign in layout.signs]
    start, destination = layout.start, layout.destination
    x, y = network.lane(start.lane).line.point_at(start.s)
    params = {"lane": start.lane, "s": repr(start.s), "speed": repr(start.speed), "target": " ".join(layout.targets)}
    params["route"] = " ".join(layout.route_hint)
    if layout.compliant_hint:
        params["compliant"] = " ".join(layout.compliant_hint)
    elements.append(_poi("start", x, y, "blue", params))
    line = network.edge_lanes(destination.edge)[0].line
    x, y = line.point_at(destination.s)
    elements.append(_poi("destination", x, y, "green", {"edge": destination.edge, "s": repr(destination.s)}))
    if layout.convoy is not None:
        held = {"vehicles": " ".join(layout.convoy.vehicles), "after_s": repr(layout.convoy.after_s)}
        held |= {"keeps_back": "1"} if layout.convoy.keeps_back else {}
        elements.append(_plan_poi("convoy", layout.convoy, held, network))
    if layout.walkers is not None:
        held = {
            "persons": " ".join(layout.walkers.persons),
            "speeds": " ".join(map(repr, layout.walkers.speeds)),
            "come_up_s": repr(layout.walkers.come_up_s),
            "until_past": str(int(layout.walkers.until_past)),
        }
        elements.append(_plan_poi("walkers", layout.walkers, held, network))
    places = {sign.id: (sign.x, sign.y) for sign in layout.signs}
    elements.extend(contrast_to_poi(clause, *places[clause.sign or layout.targets[0]]) for clause in layout.contrast)
    elements.extend(_obstacle_poly(o) for o in layout.obstacles)
    return elements


def _plan_poi(kind: str, plan: ConvoyPlan | WalkersPlan, held: dict[str, str], network: RoadNetwork) -> etree._Element:
    """The held road users and their release, at the ego's line."""
    line = network.lane(plan.line_lane).line
    params = held | {"line_lane": plan.line_lane} | {name: repr(getattr(plan, name)) for name in _PLAN}
    return _poi(kind, *line.point_at(line.length), "cyan", params)


def _obstacle_poly(o: Obstacle) -> etree._Element:
    shape = " ".join(f"{x:.3f},{y:.3f}" for x, y in corners(o.x, o.y, o.heading, o.length, o.width))
    poly = etree.Element("poly", id=o.id, type="obstacle", color="orange", fill="true", layer="80", shape=shape)
    values = {"shape": o.shape, "lane": o.lane} | {name: repr(getattr(o, name)) for name in _BOX}
    return _with_params(poly, values)


def read_additional(path: Path, content: bytes | None = None) -> etree._Element:
    """The root element of an additional file, from its uncompressed `content` where that is at hand; InputError."""
    data = read_plain(path, "scene file") if content is None else content
    return parse(data, path, "additional", "scene file")


@dataclass(frozen=True, slots=True)
class LateEntry:
    """A car that enters after the start: SUMO id and type, s, edges of its way, order of the lane that it enters on."""

    name: str
    vtype: str
    depart: float
    edges: tuple[str, ...]
    lane: int


def late_entries(additional: SceneFile) -> tuple[bytes, tuple[LateEntry, ...]]:
    """A scene's additional file without the cars that enter after the start, and these in the order of the file."""
    root = read_additional(additional.path, additional.content)
    found = []
    for vehicle in root.findall("vehicle"):
        depart, route = float(vehicle.get("depart", "0")), vehicle.find("route")
        if depart > 0.0 and route is not None:
            edges, lane = tuple(str(route.get("edges")).split()), int(str(vehicle.get("departLane")))
            found.append(LateEntry(str(vehicle.get("id")), str(vehicle.get("type")), depart, edges, lane))
            root.remove(vehicle)
    return etree.tostring(root) if found else additional.content, tuple(found)


def _params(element: etree._Element) -> dict[str, str]:
    return {str(p.attrib["key"]): str(p.attrib["value"]) for p in element.iterfind("param")}


def read_layout(path: Path, catalog: Catalog, content: bytes | None = None) -> SceneLayout:
    """The layout of a scene file. Raises InputError naming the element that is missing or wrong."""
    root = read_additional(path, content)
    signs = signs_from_additional(root, catalog, str(path))
    try:
        pois = {p.get("type"): _params(p) for p in root.iterfind("poi") if p.get("type") != "sign"}
        start, end = pois["start"], pois["destination"]
        convoy, walkers = pois.get("convoy"), pois.get("walkers")
        layout = SceneLayout(
            signs=signs,
            targets=tuple(start["target"].split()),
            obstacles=tuple(
                _obstacle(str(p.attrib["id"]), _params(p)) for p in root.iterfind("poly") if p.get("type") == "obstacle"
            ),
            start=EgoStart(start["lane"], float(start["s"]), float(start["speed"])),
            destination=Destination(end["edge"], float(end["s"])),
            convoy=None
            if convoy is None
            else ConvoyPlan(
                **_plan(convoy),
                vehicles=tuple(convoy["vehicles"].split()),
                after_s=float(convoy.get("after_s", "0.0")),
                keeps_back=convoy.get("keeps_back") == "1",
            ),
            route_hint=tuple(start["route"].split()),
            compliant_hint=tuple(start.get("compliant", "").split()),
            walkers=None if walkers is None else _walkers(walkers),
            contrast=contrast_from_additional(root, str(path)),
        )
    except KeyError as error:
        raise InputError(f"{path}: scene file lacks {error}") from None
    except ValueError as error:
        raise InputError(f"{path}: scene file: {error}") from None
    if not layout.targets:
        raise InputError(f"{path}: no target sign")
    for name in (*layout.targets, *(clause.sign for clause in layout.contrast if clause.sign)):
        if name not in {s.id for s in signs}:
            raise InputError(f"{path}: target sign {name!r} is not in the scene file")
    return layout


def _obstacle(obstacle_id: str, p: dict[str, str]) -> Obstacle:
    box: dict[str, Any] = {name: float(p[name]) for name in _BOX}
    return Obstacle(id=obstacle_id, shape=p["shape"], lane=p["lane"], **box)


def _plan(p: dict[str, str]) -> dict[str, Any]:
    return {"line_lane": p["line_lane"], **{name: float(p[name]) for name in _PLAN}}


def _walkers(p: dict[str, str]) -> WalkersPlan:
    persons, speeds = tuple(p["persons"].split()), tuple(map(float, p["speeds"].split()))
    if not persons or len(persons) != len(speeds):
        raise ValueError(f"{len(persons)} walkers with {len(speeds)} speeds")
    come_up_s, until_past = float(p.get("come_up_s", "0.0")), p.get("until_past", "0") == "1"
    return WalkersPlan(**_plan(p), persons=persons, speeds=speeds, come_up_s=come_up_s, until_past=until_past)
