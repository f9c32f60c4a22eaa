"""Who a scene places before its first tick: the ego, cars of the convoy, cars that wait or lead, pedestrians."""

from __future__ import annotations

from collections.abc import Iterator

from lxml import etree

from tsbench.report.drawing.shapes import Body
from tsbench.sim.scene import Scene
from tsbench.sim.scene_file import EGO_ID, read_additional
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M

# As tsbench.dataset.scenes.traffic names the cars that are only traffic.
_BACKGROUND = "bg_"
_CAR_M = (5.0, 1.8)


def ego_body(x: float, y: float, heading: float) -> Body:
    """The ego with its centre at (x, y)."""
    return Body("ego", EGO_ID, x, y, heading, EGO_LENGTH_M, EGO_WIDTH_M)


def staged_bodies(scene: Scene) -> list[Body]:
    """All cars that the scene itself is made of, and its held pedestrians.

    Not the ego, the background's cars, nor what stands for an obstacle. Kind `convoy`: held until the ego comes.
    """
    root = read_additional(scene.additional.path, scene.additional.content)
    return [*_cars(scene, root), *_walkers(scene, root)]


def _cars(scene: Scene, root: etree._Element) -> Iterator[Body]:
    held = scene.convoy.vehicles if scene.convoy is not None else ()
    others = {EGO_ID, *(o.id for o in scene.obstacles)}
    types = {t.get("id"): t for t in root.iterfind("vType")}
    for vehicle in root.iterfind("vehicle"):
        name, route = str(vehicle.get("id")), vehicle.find("route")
        if name in others or name.startswith(_BACKGROUND) or route is None:
            continue
        kind = types.get(vehicle.get("type"))
        length, width = (
            default if kind is None else float(kind.get(key, default))
            for key, default in zip(("length", "width"), _CAR_M, strict=True)
        )
        lanes = scene.network.edge_lanes(str(route.get("edges", "")).split()[0])
        lane = lanes[min(int(vehicle.get("departLane", 0)), len(lanes) - 1)]
        # SUMO counts along the lane's own length, which may differ from that of its drawn line.
        s = (float(vehicle.get("departPos", 0)) - length / 2) * lane.line.length / lane.length
        x, y = lane.line.point_at(s)
        yield Body("convoy" if name in held else "car", name, x, y, lane.line.heading_at(s), length, width)


def _walkers(scene: Scene, root: etree._Element) -> Iterator[Body]:
    if scene.walkers is None:
        return
    for person in root.iterfind("person"):
        name, walk = str(person.get("id")), person.find("walk")
        if name in scene.walkers.persons and walk is not None:
            lane = scene.network.edge_lanes(str(walk.get("edges", "")).split()[0])[0]
            s, d = float(person.get("departPos", 0)), float(walk.get("departPosLat", 0))
            x, y = lane.line.point_at(s, d)
            yield Body("pedestrian", name, x, y, 0.0, 0.0, 0.0)
