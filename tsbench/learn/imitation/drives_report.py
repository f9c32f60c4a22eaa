"""`tsbench train frames`: how many frames there are of what, their targets, and ten of each group as pictures.

A picture shows what the network is shown from above, and what it should answer. Ahead is up; m.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
import shapely
from matplotlib.figure import Figure

from tsbench.core.errors import InputError
from tsbench.core.files import write_atomic
from tsbench.core.seeds import rng_of
from tsbench.geometry.polyline import Array
from tsbench.learn.imitation.frames_store import FrameStore, TrainingResources
from tsbench.learn.imitation.recipe import FineTuning
from tsbench.learn.imitation.targets import FAMILIES, EpisodeDrive
from tsbench.learn.plant2 import tokens as at
from tsbench.learn.plant2.sign_tokens import Vocabulary
from tsbench.report.charts import GREY, GROUP_COLOURS, INK, PALE, save_chart
from tsbench.report.drawing.canvas import STYLE, Area, Body, Camera, Image, Line, Shape, dashes
from tsbench.report.drawing.paint import paint, save_png, sheet, text_width, write
from tsbench.report.drawing.scene_shapes import ego_body
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.model import GROUPS, ScenarioType

_COLUMNS = 5
_KINDS = {at.CAR: "car", at.BUS: "bus", at.BICYCLE: "bicycle", at.PEDESTRIAN: "pedestrian", at.STATIC: "island"}
_SIDE_M, _BACK_M, _PX_PER_M = 20.0, 12.0, 8.0
_WIDTH, _HEIGHT = round(2 * _SIDE_M * _PX_PER_M), round((at.PATCH_AHEAD_M + _BACK_M) * _PX_PER_M)
_CAMERA = Camera(-_SIDE_M, at.PATCH_AHEAD_M, _PX_PER_M, _WIDTH, _HEIGHT)
_LINE_M, _DOT_M, _LETTER_PX = 0.2, 0.35, 11


def _title(frame: at.Record, types: Sequence[ScenarioType], vocabulary: Vocabulary) -> str:
    own, other = (vocabulary.codes[k - 1] if k else "–" for k in frame["held_classes"].tolist())
    return (
        f"{types[frame['type'].item()].id}{' *' if frame['decides'] else ''}\n"
        f"holds {own}, other arm {other}, target {3.6 * frame['speed'].item():.0f} km/h, limit "
        f"{3.6 * at.SPEED_SCALE_MPS * frame['limits'][0].item():.0f}"
    )


def _panel(frame: at.Record, vocabulary: Vocabulary) -> Image:
    """Patch, objects, plates, route (green), ways on (violet, dashed), and what is to be answered: path (orange) and
    waypoints (blue).
    """
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


_PICTURES = 10
# Of a chunk this many frames of each type may become pictures.
_CANDIDATES = 4
_BESIDE_AT_M = 10
# What is kept of each frame for the figures; 8 kB of tokens are not.
_FIGURES = np.dtype(
    [("type", np.uint8), ("family", np.uint8), ("decides", np.uint8), ("speed", np.float32), ("beside", np.float32)]
)

_HISTOGRAMS = (
    ("speed", "target speed, m/s", (0.0, 20.0)),
    ("beside", "path at 10 m, m to the left (log)", (-8.0, 8.0)),
)


def report(
    drives: Sequence[EpisodeDrive], recipe: FineTuning, resources: TrainingResources, tell: Callable[[str], None]
) -> list[Path]:
    """Make the frames of all drives and write table, figure and pictures below `resources.out`; returns their paths."""
    made = 0

    def driven(count: int) -> None:
        nonlocal made
        made += count
        tell(f"{made} of {len(drives)} drives")

    source = recipe.source()
    store = FrameStore(resources, drives, source, recipe.seed, driven)
    figures, candidates = [], []
    for chunk in range(len(store)):
        frames = store.load([chunk])
        figures.append(_figures_of(frames))
        candidates.append(_drawn(frames, rng_of("frames", "pictures", recipe.seed, chunk)))
    found = np.concatenate(figures) if figures else np.zeros(0, dtype=_FIGURES)
    if not len(found):
        raise InputError("none of the drives obeyed and arrived: there are no frames to look at")
    out, types = resources.out, DataSet().catalog.types
    paths = [out / "frames.md", out / "frames.png"]
    write_atomic(paths[0], _table(found, drives, types).encode())
    save_chart(lambda: _chart(found, types), paths[1])
    for group in GROUPS:
        kinds = [k for k, kind in enumerate(types) if kind.group == group]
        chosen = _of_group(np.concatenate(candidates), kinds)
        if len(chosen):
            paths.append(out / f"frames-{group}.png")
            words = source.vocabulary
            panels = [(_title(frame, types, words), _panel(frame, words)) for frame in chosen]
            save_png(paths[-1], sheet(panels, _COLUMNS))
    return paths


def _figures_of(frames: at.Records) -> at.Records:
    found: at.Records = np.zeros(len(frames), dtype=_FIGURES)
    for name in ("type", "family", "decides", "speed"):
        found[name] = frames[name]
    last = _BESIDE_AT_M - 1
    found["beside"] = np.where(frames["path_known"][:, last] == 1, frames["path"][:, last, 1], np.nan)
    return found


def _drawn(frames: at.Records, rng: np.random.Generator) -> at.Records:
    """A few frames of each type, of decisions above all."""
    order = rng.permutation(len(frames))
    order = order[np.argsort(-frames["decides"][order].astype(int), kind="stable")]
    rows = [order[frames["type"][order] == kind][:_CANDIDATES] for kind in np.unique(frames["type"])]
    return frames[np.concatenate(rows)] if rows else frames[:0]


def _of_group(frames: at.Records, kinds: Sequence[int]) -> list[at.Record]:
    by_type = [frames[frames["type"] == k] for k in kinds]
    longest = max(map(len, by_type))
    return [rows[k] for k in range(longest) for rows in by_type if k < len(rows)][:_PICTURES]


def _table(found: at.Records, drives: Sequence[EpisodeDrive], types: Sequence[ScenarioType]) -> str:
    lines = [
        "| type | group | family | drives | frames | in decision windows | target 0 to 0.5 m/s | mean target, m/s |",
        "|---|---|---|---|---|---|---|---|",
    ]
    driven = [drive.spec.scenario_type for drive in drives]
    for k, kind in enumerate(types):
        rows = found[found["type"] == k]
        if len(rows):
            stands = 100.0 * (rows["speed"] < 0.5).mean()
            lines.append(
                f"| {kind.id} | {kind.group} | {FAMILIES[rows['family'][0]]} | {driven.count(kind.id):,} "
                f"| {len(rows):,} | {100.0 * rows['decides'].mean():.0f} % | {stands:.1f} % "
                f"| {rows['speed'].mean():.1f} |"
            )
    lines.append(f"| all | | | {len(drives):,} | {len(found):,} | {100.0 * found['decides'].mean():.0f} % | | |")
    return "\n".join(lines) + "\n"


def _chart(found: at.Records, types: Sequence[ScenarioType]) -> Figure:
    there = [k for k in range(len(types)) if (found["type"] == k).any()]
    figure = Figure(figsize=(9.0, 1.6 + 0.2 * max(len(there), 12)), layout="constrained")
    grid = figure.add_gridspec(len(FAMILIES), 3, width_ratios=(1.3, 1.0, 1.0))
    counts = figure.add_subplot(grid[:, 0])
    for place, k in enumerate(reversed(there)):
        rows = found[found["type"] == k]
        counts.barh(place, len(rows), color=PALE)
        counts.barh(place, int(rows["decides"].sum()), color=GROUP_COLOURS[types[k].group])
    counts.set_yticks(range(len(there)), [types[k].id for k in reversed(there)], fontsize="x-small")
    counts.set_title("frames; coloured: in decision windows", loc="left", fontsize="small")
    counts.tick_params(axis="x", labelsize="x-small")
    for row, family in enumerate(FAMILIES):
        for column, (name, title, (low, high)) in enumerate(_HISTOGRAMS):
            axes = figure.add_subplot(grid[row, 1 + column])
            values = found[name][found["family"] == row]
            values = np.clip(values[np.isfinite(values)], low, high)
            axes.hist(values, bins=40, range=(low, high), color=INK, log=name == "beside")
            axes.set_yticks([])
            axes.tick_params(labelsize="x-small", labelbottom=row == len(FAMILIES) - 1)
            axes.set_ylabel(family if column == 0 else "", fontsize="xx-small", color=GREY)
            if row == 0:
                axes.set_title(title, loc="left", fontsize="small")
    for axes in figure.axes:
        axes.spines[["top", "right"]].set_visible(False)
    return figure
