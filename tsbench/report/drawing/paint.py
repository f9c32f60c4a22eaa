"""Shapes into pixels with OpenCV, and pictures as PNG files. Fast: a frame of a film is a few dozen small shapes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import shapely
from PIL import Image as PilImage

from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.geometry.footprint import corners
from tsbench.geometry.polyline import Array
from tsbench.report.drawing.canvas import SHIFT, STYLE, Camera, Colour, Fixed, Image
from tsbench.report.drawing.lettering import line_height, paste, shorten, write
from tsbench.report.drawing.main_road_plate import main_road_rgba
from tsbench.report.drawing.shapes import Area, Body, DrawnPlate, Line, Shape, cone_places
from tsbench.signs.plates import plate_rgba

# Outline of a car of length and width 1, nose to +x; then the windscreen.
_HALF_BODY = [(0.5, 0.28), (0.44, 0.44), (0.3, 0.5), (-0.44, 0.5), (-0.5, 0.4)]
_BODY = np.array(_HALF_BODY + [(u, -v) for u, v in reversed(_HALF_BODY)])
_SCREEN = np.array([(0.26, 0.4), (0.1, 0.33), (0.1, -0.33), (0.26, -0.4)])
_SHAPE = np.vstack((_BODY, _SCREEN))
# Somebody on foot and a cone are wider than they are where the scale would make them a speck.
_DISC_M, _PERSON_PX, _CONE_PX = 0.35, 3.5, 6.5
_LAMP_M, _LAMP_PX = 0.22, 2.0
_PLATE_M, _PLATE_PX = 4.5, (30, 60)
_BELOW = 0.75  # of a plate's size has the one beneath it
_REACH_M = 10.0


def paint(image: Image, camera: Camera, shapes: Iterable[Shape]) -> list[tuple[float, float]]:
    """Paint shapes over a picture, in their order; plates make room for each other. Returns the plates' middles, px."""
    shapes = list(shapes)
    outlines = iter(outlines_of(camera, [shape for shape in shapes if isinstance(shape, Body)]))
    plates: list[tuple[float, float]] = []
    for shape in shapes:
        match shape:
            case Body():
                _body(image, camera, shape, next(outlines))
            case Line():
                points, colour = camera.fixed(shape.points), getattr(STYLE, shape.colour)
                cv2.polylines(image, [points], False, colour, camera.thickness(shape.width), cv2.LINE_AA, SHIFT)
            case Area():
                _area(image, camera, shape)
            case DrawnPlate():
                plates.append(_plate(image, camera, shape, plates))
    return plates


def outlines_of(camera: Camera, bodies: Sequence[Body]) -> Fixed:
    """(n, points, 2): the shapes of n vehicles where OpenCV draws them; `body_outline` is a part of each."""
    table = np.array([(b.x, b.y, b.heading, b.length, b.width) for b in bodies]).reshape(-1, 5)
    x, y, heading, length, width = table.T[:, :, None]
    c, s = np.cos(heading), np.sin(heading)
    u, v = _SHAPE[:, 0] * length, _SHAPE[:, 1] * width
    points = np.stack((x + u * c - v * s, y + u * s + v * c), axis=-1)
    return camera.fixed(points).reshape(len(bodies), len(_SHAPE), 2)


def paint_outline(image: Image, camera: Camera, body: Body, colour: Colour) -> None:
    outline = outlines_of(camera, [body])[0, : len(_BODY)]
    cv2.polylines(image, [outline], True, colour, 2, cv2.LINE_AA, SHIFT)


def _body(image: Image, camera: Camera, body: Body, outline: Fixed) -> None:
    reach = _REACH_M * camera.scale
    (x, y), height, width = (outline[0] >> SHIFT).tolist(), *image.shape[:2]
    if not (-reach < x < width + reach and -reach < y < height + reach):
        return
    colour: Colour = getattr(STYLE, "cone" if body.kind == "cones" else body.kind)
    if body.kind == "pedestrian":
        _person(image, camera, body, colour)
    elif body.kind == "bicycle":
        _bicycle(image, camera, body, colour)
    elif body.kind == "cones":
        radius = max(_DISC_M, _CONE_PX / camera.scale)
        for at in cone_places(body):
            _disc(image, camera, at, radius, colour)
            _disc(image, camera, at, 0.45 * radius, STYLE.marking)
    elif body.kind == "island":
        box = camera.fixed(np.array(corners(body.x, body.y, body.heading, body.length, body.width)))
        cv2.fillConvexPoly(image, box, colour, cv2.LINE_AA, SHIFT)
        cv2.polylines(image, [box], True, STYLE.violation, camera.thickness(0.15), cv2.LINE_AA, SHIFT)
    else:
        cv2.fillConvexPoly(image, outline[: len(_BODY)], colour, cv2.LINE_AA, SHIFT)
        cv2.polylines(image, [outline[: len(_BODY)]], True, STYLE.outline, 1, cv2.LINE_AA, SHIFT)
        cv2.fillConvexPoly(image, outline[len(_BODY) :], STYLE.glass, cv2.LINE_AA, SHIFT)
        _lights(image, camera, body)


def _in_world(body: Body, places: Array) -> Array:
    """(n, 2) of its frame (m ahead, m to the left) in the world."""
    c, s = math.cos(body.heading), math.sin(body.heading)
    turned = places @ np.array([[c, s], [-s, c]])
    found: Array = turned + np.array([body.x, body.y])
    return found


def _lights(image: Image, camera: Camera, body: Body) -> None:
    """Brake lights at both rear corners; an indicator at both corners of its side."""
    radius, u, v = max(_LAMP_M, _LAMP_PX / camera.scale), 0.46 * body.length, 0.4 * body.width
    for at in _in_world(body, np.array([(-u, v), (-u, -v)])) if body.brakes else ():
        _spot(image, camera, at, radius, STYLE.brake)
    for at in _in_world(body, np.array([(u, v * body.signals), (-u, v * body.signals)])) if body.signals else ():
        _spot(image, camera, at, radius, STYLE.lamp)


def _spot(image: Image, camera: Camera, at: Array, radius: float, colour: Colour) -> None:
    centre = camera.fixed(at)[0].tolist()
    cv2.circle(image, centre, round(radius * camera.scale * (1 << SHIFT)), colour, -1, cv2.LINE_AA, SHIFT)


def _person(image: Image, camera: Camera, body: Body, colour: Colour) -> None:
    """Shoulders across the heading, the head on them."""
    radius = max(_DISC_M, _PERSON_PX / camera.scale)
    across = camera.fixed(_in_world(body, np.array([(0.0, radius), (0.0, -radius)])))
    for thick, paint_ in ((1.2, STYLE.outline), (0.9, colour)):
        ends = (across[0].tolist(), across[1].tolist())
        cv2.line(image, *ends, paint_, camera.thickness(thick * radius), cv2.LINE_AA, SHIFT)
    _disc(image, camera, (body.x, body.y), 0.8 * radius, colour)


def _bicycle(image: Image, camera: Camera, body: Body, colour: Colour) -> None:
    """Two wheels in a line, a handlebar, and who rides."""
    half, bar = 0.5 * body.length, max(0.3, _LAMP_PX / camera.scale)
    frame = camera.fixed(_in_world(body, np.array([(-half, 0.0), (half, 0.0), (0.5 * half, bar), (0.5 * half, -bar)])))
    for first, last in ((0, 1), (2, 3)):
        ends = (frame[first].tolist(), frame[last].tolist())
        cv2.line(image, *ends, STYLE.outline, camera.thickness(0.16), cv2.LINE_AA, SHIFT)
    _disc(image, camera, (body.x, body.y), max(_DISC_M, 0.8 * _PERSON_PX / camera.scale), colour)


def _disc(image: Image, camera: Camera, at: Array | tuple[float, float], radius: float, colour: Colour) -> None:
    """A round thing with an outline; radius in m."""
    centre, size = camera.fixed(at)[0].tolist(), round(radius * camera.scale * (1 << SHIFT))
    cv2.circle(image, centre, size, colour, -1, cv2.LINE_AA, SHIFT)
    cv2.circle(image, centre, size, STYLE.outline, 1, cv2.LINE_AA, SHIFT)


def _area(image: Image, camera: Camera, area: Area) -> None:
    ground = image if area.opacity == 1.0 else image.copy()
    for polygon in shapely.get_parts(area.polygon):
        if polygon.geom_type == "Polygon" and not polygon.is_empty:
            rings = [camera.fixed(shapely.get_coordinates(r)) for r in (polygon.exterior, *polygon.interiors)]
            cv2.fillPoly(ground, rings, getattr(STYLE, area.colour), cv2.LINE_AA, SHIFT)
    if ground is not image:
        cv2.addWeighted(ground, area.opacity, image, 1.0 - area.opacity, 0.0, dst=image)


def plate_px(camera: Camera) -> int:
    """The side of a plate in a picture."""
    return round(min(max(_PLATE_M * camera.scale, _PLATE_PX[0]), _PLATE_PX[1]))


def _plate(
    image: Image, camera: Camera, plate: DrawnPlate, placed: Sequence[tuple[float, float]]
) -> tuple[float, float]:
    """A plate upright beside its post, off the road, with a frame where it is the target; returns its middle in px."""
    size = plate_px(camera)
    post = camera.px([(plate.x, plate.y)])[0]
    centre = post + plate.away * (size / 2 + 4 + plate.clear * camera.scale)
    small = round(_BELOW * size)
    if plate.below and plate.away[1] < 0.0:
        # What hangs beneath would cover the road.
        centre = centre - np.array([0.0, small + 4.0])
    while any(abs(centre[0] - x) < size and abs(centre[1] - y) < size for x, y in placed):
        centre = centre + plate.away * (size / 2)
    cv2.line(image, _fixed(post), _fixed(centre), STYLE.outline, 2, cv2.LINE_AA, SHIFT)
    cv2.circle(image, _fixed(post), 3 << SHIFT, STYLE.outline, -1, cv2.LINE_AA, SHIFT)
    if plate.target:
        half = size / 2 + 3
        frame = np.array([_fixed(centre + np.array(d) * half) for d in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
        cv2.fillPoly(image, [frame], STYLE.marking, cv2.LINE_AA, SHIFT)
        cv2.polylines(image, [frame], True, STYLE.plate_line, 3, cv2.LINE_AA, SHIFT)
    picture = plate_rgba(plate.code, plate.value, size, plate.country)
    left, top = np.rint(centre - size / 2).astype(int).tolist()
    paste(image, left, top, picture[..., :3], picture[..., 3])
    if plate.below:
        picture = main_road_rgba(plate.below, small)
        left, top = left + (size - small) // 2, top + size + (4 if plate.target else 0)
        paste(image, left, top, picture[..., :3], picture[..., 3])
    return float(centre[0]), float(centre[1])


def _fixed(point: Array) -> tuple[int, int]:
    return round(float(point[0]) * (1 << SHIFT)), round(float(point[1]) * (1 << SHIFT))


_GAP_PX, _LETTER_PX = 8, 11


def sheet(panels: Sequence[tuple[str, Image]], columns: int) -> Image:
    height, width, _ = panels[0][1].shape
    lines = max(len(text.split("\n")) for text, _ in panels)
    head = lines * line_height(_LETTER_PX) + _GAP_PX
    columns = min(columns, len(panels))
    rows = -(-len(panels) // columns)
    size = (rows * (head + height + _GAP_PX), columns * (width + _GAP_PX) + _GAP_PX, 3)
    page = np.full(size, STYLE.panel, dtype=np.uint8)
    for k, (text, picture) in enumerate(panels):
        top = k // columns * (head + height + _GAP_PX)
        left = _GAP_PX + k % columns * (width + _GAP_PX)
        for number, line in enumerate(text.split("\n")):
            y = top + _GAP_PX // 2 + number * line_height(_LETTER_PX)
            write(page, left, y, shorten(line, _LETTER_PX, width), _LETTER_PX, STYLE.ink)
        page[top + head : top + head + height, left : left + width] = picture
    return page


def save_png(path: Path, picture: Image) -> None:
    """Write a picture, (height, width, 3) RGB, whole or not at all. Raises InputError."""
    with io_errors_as_input_errors(path):
        write_atomic(path, png_bytes(picture))


def png_bytes(picture: Image) -> bytes:
    """The file of a picture, (height, width, 3) RGB."""
    file = BytesIO()
    PilImage.fromarray(picture).save(file, format="PNG", compress_level=4)
    return file.getvalue()
