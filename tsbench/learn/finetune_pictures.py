"""Frames as pictures: what the network is shown from above, and what it should answer. Ahead is up; m."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from tsbench.geometry.polyline import Array
from tsbench.planners.plant2 import layout as at
from tsbench.planners.plant2.signs import CLASSES, VOCABULARY
from tsbench.report.charts import GREY, INK
from tsbench.signs.model import ScenarioType
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M

_COLUMNS = 5
_ROUTE, _WAY, _PATH, _WAYPOINTS, _SIGN = "#009e73", "#7b3294", "#d55e00", "#0072b2", "#cc79a7"
_BODIES = {
    at.CAR: "#56b4e9",
    at.BUS: "#0072b2",
    at.BICYCLE: "#e69f00",
    at.PEDESTRIAN: "#d55e00",
    at.STATIC: INK,
}
_SIDE_M, _BACK_M = 20.0, 12.0


def draw_frames(frames: Sequence[at.Record], types: Sequence[ScenarioType]) -> Figure:
    """One panel a frame: patch, objects, plates, route (green), ways on (violet, dashed), and what is to be answered:
    path (orange) and waypoints (blue).
    """
    rows = -(-len(frames) // _COLUMNS)
    figure = Figure(figsize=(2.6 * _COLUMNS, 4.2 * rows), layout="constrained")
    for frame, axes in zip(frames, figure.subplots(rows, _COLUMNS, squeeze=False).flat, strict=False):
        _panel(axes, frame, types)
    for axes in figure.axes[len(frames) :]:
        axes.set_axis_off()
    return figure


def _panel(axes: Axes, frame: at.Record, types: Sequence[ScenarioType]) -> None:
    _ground(axes, frame["patch"])
    for kind, features in zip(frame["kinds"].tolist(), frame["objects"].tolist(), strict=True):
        if kind != at.EMPTY:
            x, y, c, s, speed, length, width = features
            place = at.POSITION_SCALE_M * np.array([x, y])
            size = length * at.LENGTH_SCALE_M, width * at.WIDTH_SCALE_M
            _body(axes, place, (c, s), size, _BODIES[kind])
            ahead = place + 1.0 * speed * at.SPEED_SCALE_MPS * np.array([c, s])
            axes.plot(*_up(np.array([place, ahead])).T, color=_BODIES[kind], lw=0.8)
    _body(axes, np.zeros(2), (1.0, 0.0), (EGO_LENGTH_M, EGO_WIDTH_M), INK)
    for way in frame["ways"][frame["way_known"].astype(bool)]:
        points = way[: -at.WAY_FACTS].reshape(-1, 2) * at.POSITION_SCALE_M
        axes.plot(*_up(points).T, "--", color=_WAY, lw=0.8)
    axes.plot(*_up(frame["route"] * at.POSITION_SCALE_M).T, "-", color=_ROUTE, lw=1.0)
    known = frame["path_known"].astype(bool), frame["waypoints_known"].astype(bool)
    axes.plot(*_up(frame["path"][known[0]]).T, ".", color=_PATH, ms=4)
    axes.plot(*_up(frame["waypoints"][known[1]]).T, "x", color=_WAYPOINTS, ms=4)
    for code, features in zip(frame["sign_classes"].tolist(), frame["signs"].tolist(), strict=True):
        if code:
            place = _up(at.POSITION_SCALE_M * np.array([features[:2]]))[0]
            _plate(axes, place, features[2:4], "/".join(CLASSES[code - 1]))
    state = frame["sign_state"].item()
    holds = VOCABULARY[state - 1] if state else "–"
    axes.set_title(
        f"{types[frame['type'].item()].id}{' *' if frame['decides'] else ''}\n"
        f"holds {holds}, wish {3.6 * frame['speed'].item():.0f} km/h, limit "
        f"{3.6 * at.SPEED_SCALE_MPS * frame['limits'][0].item():.0f}",
        fontsize="small",
    )
    axes.set_xlim(-_SIDE_M, _SIDE_M)
    axes.set_ylim(-_BACK_M, at.PATCH_AHEAD_M)
    axes.set_aspect("equal")
    axes.tick_params(labelsize=6, colors=GREY)


def _ground(axes: Axes, patch: at.Records) -> None:
    """Road light grey, lane borders white, the drawn route pale green."""
    road, border, route = (channel.astype(np.float64)[..., None] / 255.0 for channel in patch)
    picture = 1.0 - road * (1.0 - np.array([0.80, 0.80, 0.80]))
    picture = picture * (1.0 - 0.5 * route) + 0.5 * route * np.array([0.70, 0.90, 0.80])
    picture = picture * (1.0 - border) + border
    half = 0.5 * at.PATCH_COLUMNS * at.PATCH_M_PER_PX
    low = at.PATCH_AHEAD_M - at.PATCH_ROWS * at.PATCH_M_PER_PX
    axes.imshow(picture, extent=(-half, half, low, at.PATCH_AHEAD_M), interpolation="nearest")


def _plate(axes: Axes, place: Array, faces: Sequence[float], code: str) -> None:
    """At the picture's edge where the plate is farther away; the stroke shows whose direction of travel it faces."""
    x = float(np.clip(place[0], -_SIDE_M + 2.0, _SIDE_M - 2.0))
    y = float(np.clip(place[1], -_BACK_M + 1.0, at.PATCH_AHEAD_M - 2.0))
    away = "" if abs(y - place[1]) < 0.1 else f" {place[1]:.0f} m"
    axes.plot([x, x - 2.5 * faces[1]], [y, y + 2.5 * faces[0]], color=_SIGN, lw=1.5)
    axes.plot(x, y, "s", color=_SIGN, ms=5)
    axes.text(x, y, f" {code}{away} ", fontsize=6, ha="left" if x < 0.0 else "right", va="bottom")


def _body(
    axes: Axes, place: Array, along: tuple[float, float], size: tuple[float, float], colour: str
) -> None:
    c, s = along
    corners = np.array([(u * size[0] / 2, v * size[1] / 2) for u, v in ((1, 1), (1, -1), (-1, -1), (-1, 1))])
    world = corners @ np.array([[c, s], [-s, c]]) + place
    axes.add_patch(Polygon(_up(world), closed=True, facecolor=colour, alpha=0.8, lw=0.0))


def _up(points: Array) -> Array:
    """(k, 2) ahead and left to right and up."""
    turned: Array = np.asarray(points, dtype=np.float64) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    return turned
