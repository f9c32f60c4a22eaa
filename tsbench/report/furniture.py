"""What stands in a scene: plates, obstacles, destination, ways. Units: m, rad; plates in px."""

from __future__ import annotations

import math

import cv2
import numpy as np

from tsbench.geometry.polyline import Array, Polyline
from tsbench.maps.network import RoadNetwork
from tsbench.metrics.outcome import ARRIVAL_M
from tsbench.report.bodies import draw_obstacle
from tsbench.report.camera import SHIFT, Camera, Image
from tsbench.report.lettering import paste
from tsbench.report.roads import dashes, draw_line
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
    s = scene.destination.s
    tinted = image.copy()
    middles = []
    for lane in scene.network.edge_lanes(scene.destination.edge):
        if not lane.permits("passenger"):
            continue
        a, b = max(s - ARRIVAL_M, 0.0), min(s + ARRIVAL_M, lane.line.length)
        if b - a < 0.1:
            continue
        piece, half = lane.line.slice(a, b), lane.width / 2
        outline = np.vstack((piece.beside(half), piece.beside(-half)[::-1]))
        cv2.fillPoly(tinted, [camera.fixed(outline)], STYLE.destination, cv2.LINE_AA, SHIFT)
        middles.append(lane.line.point_at(s))
    cv2.addWeighted(tinted, 0.6, image, 0.4, 0.0, dst=image)
    if middles:
        centre = camera.fixed(np.mean(middles, axis=0))[0].tolist()
        for radius, colour in ((1.5, STYLE.marking), (1.1, STYLE.destination), (0.5, STYLE.marking)):
            cv2.circle(
                image, centre, round(radius * camera.scale * (1 << SHIFT)), colour, -1, cv2.LINE_AA, SHIFT
            )


def draw_plate_line(image: Image, camera: Camera, network: RoadNetwork, sign: SignInstance) -> None:
    """The cross-section of the road at which a plate begins to bind."""
    lanes = network.edge_lanes(sign.edge)
    right, left = lanes[0], lanes[-1]
    at = min(sign.position_m, right.line.length)
    across = [right.line.point_at(at, -right.width / 2), left.line.point_at(at, left.width / 2)]
    for dash in dashes(Polyline(across), 0.7, 0.5):
        draw_line(image, camera, dash, STYLE.plate_line, camera.thickness(0.25))


def draw_plates(image: Image, camera: Camera, scene: Scene, size: int) -> None:
    """Every plate upright beside its post, away from the lane that it faces; the target has a frame."""
    placed: list[tuple[float, float]] = []
    for sign in sorted(scene.signs, key=lambda s: s.id != scene.target):
        post = camera.px([(sign.x, sign.y)])[0]
        away, clear = _way_off(scene.network, sign)
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


def _way_off(network: RoadNetwork, sign: SignInstance) -> tuple[Array, float]:
    """Unit vector in the picture that leads from a post off the road, and how far the kerb is, m (0 beside it)."""
    # To the right of the traffic that the plate faces; pixel rows grow downwards.
    right = np.array([math.sin(sign.heading), math.cos(sign.heading)])
    lanes = network.edge_lanes(sign.edge)
    to_right = lanes[0].line.project(sign.x, sign.y)[1] + lanes[0].width / 2
    to_left = lanes[-1].width / 2 - lanes[-1].line.project(sign.x, sign.y)[1]
    if min(to_right, to_left) <= 0.0:
        return (right if to_right <= 0.0 else -right), 0.0
    edge = network.edges[sign.edge]
    two_way = any((e.source, e.target) == (edge.target, edge.source) for e in network.edges.values())
    # A post on an island: to the nearer kerb, but never over the other direction's lanes.
    return (right, to_right) if two_way or to_right <= to_left else (-right, to_left)


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
    start = scene.network.lane(scene.start.lane)
    path = graph.path(edges, start.index, scene.start.s, scene.destination) if edges else None
    if path is None:
        return np.zeros((0, 2))
    line = path.line.slice(0.0, path.destination_s) if path.destination_s > 1.0 else path.line
    points = line.beside(d)
    draw_line(image, camera, points, colour, camera.thickness(0.35))
    return points
