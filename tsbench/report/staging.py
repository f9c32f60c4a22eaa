"""Who a scene places before its first tick: the ego, cars of the convoy, cars that wait or lead, pedestrians."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsbench.report.bodies import draw_pedestrian, draw_vehicle
from tsbench.report.camera import Camera, Image
from tsbench.report.style import STYLE
from tsbench.sim.scene import Scene
from tsbench.sim.scene_file import EGO_ID, read_additional
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M

# As tsbench.scenarios.traffic names the cars that are only traffic.
_BACKGROUND = "bg_"
_CAR_M = (5.0, 1.8)


@dataclass(frozen=True, slots=True)
class StagedCar:
    """A car at the start: its centre, m and rad, its size, m. held: it is of the convoy, and waits for the ego."""

    x: float
    y: float
    heading: float
    length: float
    width: float
    held: bool


def staged_cars(scene: Scene) -> list[StagedCar]:
    """All cars that the scene itself is made of; not the ego, the background's, nor what stands for an obstacle."""
    held = scene.convoy.vehicles if scene.convoy is not None else ()
    others = {EGO_ID, *(o.id for o in scene.obstacles)}
    root = read_additional(scene.additional.path, scene.additional.content)
    types = {t.get("id"): t for t in root.iterfind("vType")}
    cars = []
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
        cars.append(StagedCar(x, y, lane.line.heading_at(s), length, width, name in held))
    return cars


def walker_places(scene: Scene) -> list[tuple[float, float]]:
    """Where the held pedestrians stand."""
    if scene.walkers is None:
        return []
    places = []
    for person in read_additional(scene.additional.path, scene.additional.content).iterfind("person"):
        walk = person.find("walk")
        if person.get("id") in scene.walkers.persons and walk is not None:
            lane = scene.network.edge_lanes(str(walk.get("edges", "")).split()[0])[0]
            s, d = float(person.get("departPos", 0)), float(walk.get("departPosLat", 0))
            places.append(lane.line.point_at(s, d))
    return places


def draw_start(image: Image, camera: Camera, scene: Scene) -> None:
    """All of them, the ego on top."""
    for car in staged_cars(scene):
        colour = STYLE.convoy if car.held else STYLE.car
        draw_vehicle(image, camera, car.x, car.y, car.heading, car.length, car.width, colour)
    for place in walker_places(scene):
        draw_pedestrian(image, camera, np.array(place))
    line = scene.network.lane(scene.start.lane).line
    x, y = line.point_at(scene.start.s)
    draw_vehicle(image, camera, x, y, line.heading_at(scene.start.s), EGO_LENGTH_M, EGO_WIDTH_M, STYLE.ego)
