"""What stands in a scene: plates, obstacles, destination, ways. Units: m, rad; plates in px."""

from __future__ import annotations

import cv2
import numpy as np

from tsbench.geometry.polyline import Array, Polyline
from tsbench.maps.network import RoadNetwork
from tsbench.report.bodies import draw_obstacle
from tsbench.report.camera import SHIFT, Camera, Image
from tsbench.report.lettering import paste
from tsbench.report.places import destination_place, plate_line, way_off, way_points
from tsbench.report.roads import dashes, draw_line, fill
from tsbench.report.style import STYLE, Colour
from tsbench.signs.annotations import SignInstance
from tsbench.signs.plates import plate_rgba
from tsbench.sim.lanegraph import LaneGraph
from tsbench.sim.scene import Scene


def draw_furniture(image: Image, camera: Camera, scene: Scene, plate_px: int) -> None:
    """Destination, the target plate's line, obstacles and plates."""
    draw_destination(image, camera, scene)
    draw_plate_line(image, camera, scene.network, scene.target_sign)
    for obstacle in scene.obstacles:
        draw_obstacle(image, camera, obstacle)
    draw_plates(image, camera, scene, plate_px)


def draw_destination(image: Image, camera: Camera, scene: Scene) -> None:
    """The stretch of road in which the ego has arrived, tinted, and a ring at its middle."""
    ground, middle = destination_place(scene)
    tinted = image.copy()
    fill(tinted, camera, ground, STYLE.destination)
    cv2.addWeighted(tinted, 0.6, image, 0.4, 0.0, dst=image)
    centre = camera.fixed(middle)[0].tolist()
    for radius, colour in ((1.5, STYLE.marking), (1.1, STYLE.destination), (0.5, STYLE.marking)):
        size = round(radius * camera.scale * (1 << SHIFT))
        cv2.circle(image, centre, size, colour, -1, cv2.LINE_AA, SHIFT)


def draw_plate_line(image: Image, camera: Camera, network: RoadNetwork, sign: SignInstance) -> None:
    """The cross-section of the road at which a plate begins to bind."""
    for dash in dashes(Polyline(plate_line(network, sign)), 0.7, 0.5):
        draw_line(image, camera, dash, STYLE.plate_line, camera.thickness(0.25))


def draw_plates(image: Image, camera: Camera, scene: Scene, size: int) -> None:
    """Every plate upright beside its post, away from the lane that it faces; the target has a frame."""
    placed: list[tuple[float, float]] = []
    for sign in sorted(scene.signs, key=lambda s: s.id != scene.target):
        post = camera.px([(sign.x, sign.y)])[0]
        away, clear = way_off(scene.network, sign)
        centre = post + away * (size / 2 + 4 + clear * camera.scale)
        while any(abs(centre[0] - x) < size and abs(centre[1] - y) < size for x, y in placed):
            centre = centre + away * (size / 2)
        placed.append((float(centre[0]), float(centre[1])))
        cv2.line(image, _fixed(post), _fixed(centre), STYLE.outline, 2, cv2.LINE_AA, SHIFT)
        cv2.circle(image, _fixed(post), 3 << SHIFT, STYLE.outline, -1, cv2.LINE_AA, SHIFT)
        if sign.id == scene.target:
            draw_frame(image, centre, size)
        plate = plate_rgba(sign.code, sign.value, size)
        corner = np.rint(centre - size / 2).astype(int)
        paste(image, int(corner[0]), int(corner[1]), plate[..., :3], plate[..., 3])


def draw_frame(image: Image, centre: Array, size: int) -> None:
    """The frame around the plate that the scenario is about."""
    half = size / 2 + 3
    box = [centre + np.array(d) * half for d in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    points = np.array([_fixed(p) for p in box], dtype=np.int32)
    cv2.fillPoly(image, [points], STYLE.marking, cv2.LINE_AA, SHIFT)
    cv2.polylines(image, [points], True, STYLE.plate_line, 3, cv2.LINE_AA, SHIFT)


def _fixed(point: Array) -> tuple[int, int]:
    return round(float(point[0]) * (1 << SHIFT)), round(float(point[1]) * (1 << SHIFT))


def draw_way(
    image: Image,
    camera: Camera,
    scene: Scene,
    graph: LaneGraph,
    edges: tuple[str, ...],
    colour: Colour,
    d: float,
) -> Array:
    """A way over edges from the start to the destination, d to the left; returns its points, (n, 2)."""
    points = way_points(scene, graph, edges, d)
    if len(points):
        draw_line(image, camera, points, colour, camera.thickness(0.35))
    return points
