"""Text and shapes into pixels with OpenCV, and pictures as PNG files.

Fast: a frame of a film is a few dozen small shapes. The letters are DejaVu Sans (it comes
with matplotlib), each piece rendered once, then blended.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from io import BytesIO
from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np
import shapely
from PIL import Image as PilImage
from PIL import ImageDraw, ImageFont, features

from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.geometry.footprint import corners
from tsbench.geometry.polyline import Array
from tsbench.report.charts import legible
from tsbench.report.drawing.canvas import (
    SHIFT,
    STYLE,
    Area,
    Body,
    Camera,
    Colour,
    DrawnPlate,
    Fixed,
    Image,
    Line,
    Shape,
    cone_places,
)
from tsbench.report.drawing.road_shapes import main_road_rgba
from tsbench.signs.plates import plate_rgba

# Whatever a text begins with, its words stand from left to right; without Raqm all letters do.
_DIRECTION = "ltr" if features.check("raqm") else None


@cache
def _font(size: int, bold: bool, file: str = "") -> ImageFont.FreeTypeFont:
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(file or str(Path(mpl.get_data_path()) / "fonts" / "ttf" / name), size)


@lru_cache(maxsize=4096)
def _mask(text: str, size: int, bold: bool) -> Image:
    shown, file = legible(text)
    ascent, descent = _font(size, bold).getmetrics()
    picture = PilImage.new("L", (max(text_width(text, size, bold), 1), ascent + descent), 0)
    # On one base line, whatever the font.
    font = _font(size, bold, file)
    ImageDraw.Draw(picture).text((0, ascent), shown, fill=255, font=font, anchor="ls", direction=_DIRECTION)
    return np.array(picture)


@lru_cache(maxsize=4096)
def text_width(text: str, size: int, bold: bool = False) -> int:
    shown, file = legible(text)
    return int(np.ceil(_font(size, bold, file).getlength(shown, direction=_DIRECTION)))


def line_height(size: int) -> int:
    ascent, descent = _font(size, False).getmetrics()
    return ascent + descent


def write(image: Image, x: int, y: int, text: str, size: int, colour: Colour, bold: bool = False) -> int:
    """Write a line with its upper left corner at (x, y), clipped at the image; returns the x behind it."""
    mask = _mask(text, size, bold)
    blend(image, x, y, mask, colour)
    return x + int(mask.shape[1])


@lru_cache(maxsize=512)
def tile(text: str, size: int, colour: Colour, ground: Colour, bold: bool = False) -> Image:
    """A piece of text on a ground of one colour, (h, w, 3): to be copied into frames without blending."""
    mask = _mask(text, size, bold)
    image = np.empty((*mask.shape, 3), dtype=np.uint8)
    image[:] = ground
    blend(image, 0, 0, mask, colour)
    return image


def stamp(image: Image, x: int, y: int, picture: Image) -> int:
    """Copy an opaque picture (h, w, 3) that lies within the image; returns the x behind it."""
    height, width = picture.shape[:2]
    image[y : y + height, x : x + width] = picture
    return int(x + width)


@dataclass(frozen=True)
class Label:
    """Text with a halo, legible on any ground. (h, w, 3) each: share, what it adds; rest, what it lets through."""

    share: Image
    rest: Image

    def lay(self, image: Image, x: int, y: int) -> None:
        """Lay it over the image, wholly within it; at every frame, so by OpenCV's few passes."""
        height, width = self.share.shape[:2]
        below = image[y : y + height, x : x + width]
        cv2.multiply(below, self.rest, dst=below, scale=1 / 255)
        cv2.add(below, self.share, dst=below)


@cache
def label(text: str, size: int, colour: Colour, halo: Colour) -> Label:
    inner = np.pad(_mask(text, size, False), 1)
    outer = np.max([np.roll(inner, step, axis) for step in (-1, 1) for axis in (0, 1)], axis=0)
    share = np.empty((*inner.shape, 3), dtype=np.uint8)
    share[:] = halo
    blend(share, 0, 0, inner, colour)
    alpha = np.repeat(np.maximum(outer, inner)[..., None], 3, axis=2)
    return Label(cv2.multiply(share, alpha, scale=1 / 255), 255 - alpha)


def blend(image: Image, x: int, y: int, mask: Image, colour: Colour) -> None:
    """Lay a colour over the image through a mask (h, w), clipped at the image's edges."""
    paste(image, x, y, np.broadcast_to(np.array(colour, dtype=np.uint8), (*mask.shape, 3)), mask)


def paste(image: Image, x: int, y: int, picture: Image, alpha: Image) -> None:
    """Lay a picture (h, w, 3) with alpha (h, w) over the image, clipped at its edges."""
    height, width = alpha.shape
    x0, y0 = max(x, 0), max(y, 0)
    x1, y1 = min(x + width, image.shape[1]), min(y + height, image.shape[0])
    if x0 >= x1 or y0 >= y1:
        return
    a = alpha[y0 - y : y1 - y, x0 - x : x1 - x, None].astype(np.uint16)
    top = picture[y0 - y : y1 - y, x0 - x : x1 - x].astype(np.uint16)
    below = image[y0:y1, x0:x1]
    below[:] = (top * a + below * (255 - a) + 127) // 255


def wrap(text: str, size: int, width: int, lines: int) -> list[str]:
    """Break a text into at most `lines` lines of `width` px; what does not fit ends in an ellipsis."""
    out: list[str] = []
    line = ""
    for word in text.split():
        longer = f"{line} {word}".strip()
        if line and text_width(longer, size) > width:
            out.append(line)
            line = word
        else:
            line = longer
    out.append(line)
    if len(out) > lines:
        out = [*out[: lines - 1], out[lines - 1] + " …"]
    return [shorten(row, size, width) for row in out]


def fitted(text: str, sizes: Sequence[int], width: int, bold: bool = False) -> tuple[str, int]:
    """The text and the first of the sizes in which it fits into `width` px; if none, cut in the last one."""
    for size in sizes:
        if text_width(text, size, bold) <= width:
            return text, size
    return shorten(text, sizes[-1], width, bold), sizes[-1]


def shorten(text: str, size: int, width: int, bold: bool = False) -> str:
    """The text, or as much of it as fits into `width` px with an ellipsis."""
    if text_width(text, size, bold) <= width:
        return text
    while text and text_width(text + "…", size, bold) > width:
        text = text[:-1]
    return text + "…"


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
    picture = plate_rgba(plate.artwork, plate.code, plate.value, size, temporary=plate.temporary)
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
