"""Road users and obstacles as shapes. Units: m, rad."""

from __future__ import annotations

import math

import cv2
import numpy as np

from tsbench.geometry.footprint import corners
from tsbench.geometry.polyline import Array
from tsbench.report.camera import SHIFT, Camera, Fixed, Image
from tsbench.report.style import STYLE, Colour
from tsbench.sim.scene import Obstacle
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M, ActorKind, Actors

CONVOY_PREFIX = "convoy"
_COLOURS: dict[int, Colour] = {
    ActorKind.CAR: STYLE.car,
    ActorKind.BUS: STYLE.bus,
    ActorKind.BICYCLE: STYLE.bicycle,
    ActorKind.PEDESTRIAN: STYLE.pedestrian,
}
# Outline of a car of length and width 1, nose to +x; then the windscreen.
_HALF_BODY = [(0.5, 0.28), (0.44, 0.44), (0.3, 0.5), (-0.44, 0.5), (-0.5, 0.4)]
_BODY = np.array(_HALF_BODY + [(u, -v) for u, v in reversed(_HALF_BODY)])
_SCREEN = np.array([(0.26, 0.4), (0.1, 0.33), (0.1, -0.33), (0.26, -0.4)])
_SHAPE = np.vstack((_BODY, _SCREEN))


def draw_actors(image: Image, camera: Camera, actors: Actors) -> None:
    """All road users of a tick that are in the picture."""
    table = actors.table
    middles = camera.px(actors.pose[:, :2])
    reach = 10.0 * camera.scale
    inside = np.all((middles > -reach) & (middles < (camera.width + reach, camera.height + reach)), axis=1)
    seen = np.nonzero(inside)[0]
    rows = actors.index[seen]
    shapes = _placed(camera, actors.pose[seen], table.length[rows], table.width[rows])
    for k, row, shape in zip(seen.tolist(), rows.tolist(), shapes, strict=True):
        kind = int(table.kind[row])
        if kind == ActorKind.PEDESTRIAN:
            draw_pedestrian(image, camera, actors.pose[k, :2])
        else:
            convoy = table.ids[row].startswith(CONVOY_PREFIX)
            _draw_body(image, shape, STYLE.convoy if convoy else _COLOURS[kind])


def draw_pedestrian(image: Image, camera: Camera, at: Array) -> None:
    """Somebody on foot, wider than they are where the scale would make them a speck."""
    draw_disc(image, camera, at, max(0.35, 3.5 / camera.scale), _COLOURS[ActorKind.PEDESTRIAN])


def draw_ego(image: Image, camera: Camera, x: float, y: float, heading: float) -> None:
    """The ego."""
    draw_vehicle(image, camera, x, y, heading, EGO_LENGTH_M, EGO_WIDTH_M, STYLE.ego)


def draw_vehicle(
    image: Image,
    camera: Camera,
    x: float,
    y: float,
    heading: float,
    length: float,
    width: float,
    colour: Colour,
) -> None:
    """A body with a windscreen that shows its front."""
    pose = np.array([(x, y, heading)])
    _draw_body(image, _placed(camera, pose, np.array([length]), np.array([width]))[0], colour)


def draw_ghost(image: Image, camera: Camera, x: float, y: float, heading: float, colour: Colour) -> None:
    """The ego's outline only: where it was."""
    pose = np.array([(x, y, heading)])
    shape = _placed(camera, pose, np.array([EGO_LENGTH_M]), np.array([EGO_WIDTH_M]))[0]
    cv2.polylines(image, [shape[: len(_BODY)]], True, colour, 2, cv2.LINE_AA, SHIFT)


def _draw_body(image: Image, shape: Fixed, colour: Colour) -> None:
    body = shape[: len(_BODY)]
    cv2.fillConvexPoly(image, body, colour, cv2.LINE_AA, SHIFT)
    cv2.polylines(image, [body], True, STYLE.outline, 1, cv2.LINE_AA, SHIFT)
    cv2.fillConvexPoly(image, shape[len(_BODY) :], STYLE.glass, cv2.LINE_AA, SHIFT)


def _placed(camera: Camera, pose: Array, length: Array, width: Array) -> Fixed:
    """(n, points, 2): the shapes of n vehicles, body first, then windscreen, where OpenCV draws them."""
    c, s = np.cos(pose[:, 2:]), np.sin(pose[:, 2:])
    u, v = _SHAPE[:, 0] * length[:, None], _SHAPE[:, 1] * width[:, None]
    points = np.stack((pose[:, :1] + u * c - v * s, pose[:, 1:2] + u * s + v * c), axis=-1)
    return camera.fixed(points).reshape(len(pose), len(_SHAPE), 2)


def draw_disc(image: Image, camera: Camera, at: Array, radius: float, colour: Colour) -> None:
    """A round thing with an outline; radius in m."""
    centre, size = camera.fixed(at)[0].tolist(), round(radius * camera.scale * (1 << SHIFT))
    cv2.circle(image, centre, size, colour, -1, cv2.LINE_AA, SHIFT)
    cv2.circle(image, centre, size, STYLE.outline, 1, cv2.LINE_AA, SHIFT)


def draw_obstacle(image: Image, camera: Camera, obstacle: Obstacle) -> None:
    """Cones in a row, or an island with a kerb."""
    o = obstacle
    if o.shape == "cones":
        n = max(round(o.length / 1.5), 2)
        for k in range(n):
            along = (k / (n - 1) - 0.5) * (o.length - 0.4)
            at = np.array([o.x + along * math.cos(o.heading), o.y + along * math.sin(o.heading)])
            # Wider than a cone is, where the scale would make it a speck.
            radius = max(0.35, 4.5 / camera.scale)
            draw_disc(image, camera, at, radius, STYLE.cone)
            draw_disc(image, camera, at, 0.45 * radius, STYLE.marking)
        return
    box = camera.fixed(np.array(corners(o.x, o.y, o.heading, o.length, o.width)))
    cv2.fillConvexPoly(image, box, STYLE.island, cv2.LINE_AA, SHIFT)
    cv2.polylines(image, [box], True, STYLE.violation, camera.thickness(0.15), cv2.LINE_AA, SHIFT)
