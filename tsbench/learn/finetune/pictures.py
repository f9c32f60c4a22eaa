"""Frames as pictures: what the network is shown from above, and what it should answer. Ahead is up; m."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import cv2
import numpy as np
import shapely

from tsbench.geometry.polyline import Array
from tsbench.learn.plant2 import layout as at
from tsbench.learn.plant2.vocabulary import Vocabulary
from tsbench.report.drawing.canvas import STYLE, Area, Body, Camera, Image, Line, Shape, dashes
from tsbench.report.drawing.paint import paint, sheet, text_width, write
from tsbench.report.drawing.scene_shapes import ego_body
from tsbench.signs.model import ScenarioType

_COLUMNS = 5
_KINDS = {at.CAR: "car", at.BUS: "bus", at.BICYCLE: "bicycle", at.PEDESTRIAN: "pedestrian", at.STATIC: "island"}
_SIDE_M, _BACK_M, _PX_PER_M = 20.0, 12.0, 8.0
_WIDTH, _HEIGHT = round(2 * _SIDE_M * _PX_PER_M), round((at.PATCH_AHEAD_M + _BACK_M) * _PX_PER_M)
_CAMERA = Camera(-_SIDE_M, at.PATCH_AHEAD_M, _PX_PER_M, _WIDTH, _HEIGHT)
_LINE_M, _DOT_M, _LETTER_PX = 0.2, 0.35, 11


def draw_frames(frames: Sequence[at.Record], types: Sequence[ScenarioType], vocabulary: Vocabulary) -> Image:
    """One panel a frame: patch, objects, plates, route (green), ways on (violet, dashed), and what is to be answered:
    path (orange) and waypoints (blue).
    """
    return sheet([(_title(frame, types, vocabulary), _panel(frame, vocabulary)) for frame in frames], _COLUMNS)


def _title(frame: at.Record, types: Sequence[ScenarioType], vocabulary: Vocabulary) -> str:
    own, other = (vocabulary.codes[k - 1] if k else "–" for k in frame["held_classes"].tolist())
    return (
        f"{types[frame['type'].item()].id}{' *' if frame['decides'] else ''}\n"
        f"holds {own}, other arm {other}, target {3.6 * frame['speed'].item():.0f} km/h, limit "
        f"{3.6 * at.SPEED_SCALE_MPS * frame['limits'][0].item():.0f}"
    )


def _panel(frame: at.Record, vocabulary: Vocabulary) -> Image:
    image = _ground(frame["patch"])
    paint(image, _CAMERA, (*_bodies(frame), *_answers(frame)))
    for code, features in zip(frame["sign_classes"].tolist(), frame["signs"].tolist(), strict=True):
        if code:
            _plate(image, features, vocabulary.codes[code - 1])
    return image


def _ground(patch: at.Records) -> Image:
    """Road, lane borders and the drawn route as far as the panel reaches."""
    road, border, route = (channel.astype(np.float64)[..., None] / 255.0 for channel in patch)
    picture = np.full((at.PATCH_ROWS, at.PATCH_COLUMNS, 3), STYLE.ground, dtype=np.float64)
    for share, colour in ((road, STYLE.kerb), (0.4 * route, STYLE.compliant), (border, STYLE.marking)):
        picture = picture * (1.0 - share) + share * np.array(colour)
    px = round(at.PATCH_M_PER_PX * _PX_PER_M)
    wide = cv2.resize(picture.astype(np.uint8), None, fx=px, fy=px, interpolation=cv2.INTER_NEAREST)
    image = np.full((_CAMERA.height, _CAMERA.width, 3), STYLE.ground, dtype=np.uint8)
    rows, left = min(len(wide), len(image)), (_CAMERA.width - wide.shape[1]) // 2
    image[:rows, left : left + wide.shape[1]] = wide[:rows]
    return image


def _bodies(frame: at.Record) -> Iterator[Shape]:
    """The ego, and the objects with where they will be in a second."""
    for kind, features in zip(frame["kinds"].tolist(), frame["objects"].tolist(), strict=True):
        if kind != at.EMPTY:
            x, y, c, s, speed, length, width = features
            place = at.POSITION_SCALE_M * np.array([x, y])
            ends = _up(np.array([place, place + 1.0 * speed * at.SPEED_SCALE_MPS * np.array([c, s])]))
            heading, (x, y) = math.atan2(s, c) + math.pi / 2, ends[0].tolist()
            yield Body(_KINDS[kind], "", x, y, heading, length * at.LENGTH_SCALE_M, width * at.WIDTH_SCALE_M)
            yield Line("outline", ends, _LINE_M)
    yield ego_body(0.0, 0.0, math.pi / 2)


def _answers(frame: at.Record) -> Iterator[Shape]:
    for way in frame["ways"][frame["way_known"].astype(bool)]:
        points = _up(way[: -at.WAY_FACTS].reshape(-1, 2) * at.POSITION_SCALE_M)
        for dash in dashes(points, 1.0, 0.7):
            yield Line("convoy", dash, _LINE_M)
    yield Line("compliant", _up(frame["route"] * at.POSITION_SCALE_M), _LINE_M)
    for name, colour in (("path", "cone"), ("waypoints", "route")):
        known = _up(frame[name][frame[f"{name}_known"].astype(bool)])
        yield Area(colour, shapely.MultiPoint(known).buffer(_DOT_M))


def _plate(image: Image, features: Sequence[float], code: str) -> None:
    """At the picture's edge where the plate is farther away; the stroke shows whose direction of travel it faces."""
    place = _up(at.POSITION_SCALE_M * np.array([features[:2]]))[0]
    x = float(np.clip(place[0], -_SIDE_M + 2.0, _SIDE_M - 2.0))
    y = float(np.clip(place[1], -_BACK_M + 1.0, at.PATCH_AHEAD_M - 2.0))
    away = "" if abs(y - place[1]) < 0.1 else f" {place[1]:.0f} m"
    stroke = np.array([(x, y), (x - 2.5 * features[3], y + 2.5 * features[2])])
    post = shapely.Point(x, y).buffer(0.5, cap_style="square")
    paint(image, _CAMERA, (Line("violation", stroke, 0.3), Area("violation", post)))
    left, top = np.rint(_CAMERA.px([(x, y)])[0]).astype(int).tolist()
    text = f"{code}{away}"
    left += 8 if x < 0.0 else -8 - text_width(text, _LETTER_PX)
    write(image, left, top - 16, text, _LETTER_PX, STYLE.outline)


def _up(points: Array) -> Array:
    """(k, 2) ahead and left to right and up."""
    turned: Array = np.asarray(points, dtype=np.float64) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    return turned
