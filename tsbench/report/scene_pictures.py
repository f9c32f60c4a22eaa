"""Pictures and films of episodes and scenes as files: PNG, GIF, MP4. No display is needed."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from tsbench.core.errors import InputError
from tsbench.episode.trace import Trace
from tsbench.geometry.polyline import Array
from tsbench.report.drawing.birds_eye import BirdsEye
from tsbench.report.drawing.canvas import STYLE, Camera, Image, PageSize, camera_over
from tsbench.report.drawing.hud import draw_attribution, draw_scale_bar, header
from tsbench.report.drawing.lettering import write
from tsbench.report.drawing.paint import paint, plate_px, save_png
from tsbench.report.drawing.road_shapes import ground_shapes, road_shapes
from tsbench.report.drawing.scene_shapes import furniture_shapes, start_shapes, way_off, way_shapes
from tsbench.report.episode_files import FileKind
from tsbench.report.film import render_gif, render_mp4
from tsbench.report.wording import scene_facts
from tsbench.roads.lane_graph import LaneGraph
from tsbench.signs.countries import Country
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S

FORMATS = ("png", "gif", "mp4")
PNG_SIZE = PageSize(1400, 1050)
_PLATE_NEAR_M = 90.0
# Of a scene: room around what it has, and px per m.
_MARGIN_M, _SCALES = 14.0, (0.7, 12.0)
_LEGEND = {
    "ego": "ego at its start",
    "destination": "destination",
    "route": "navigation's way",
    "compliant": "obedient way",
    "convoy": "convoy, held until the ego comes",
    "car": "car that waits or leads",
    "bicycle": "bicycles, held until the ego comes",
    "pedestrian": "pedestrians, held until the ego comes",
    "plate_line": "line of the plate",
}
_ALWAYS = ("destination", "plate_line")


def picture_kind(
    name: str | None, out: Path | None, time: float | None = None, country: Country | None = None
) -> FileKind:
    """Pictures or films of episodes.

    name: one of FORMATS, by default what the suffix of `out` says, else png; time (s): the moment of a PNG; country:
    whose code the caption gives the sign. Raises InputError.
    """
    if name is None:
        name = out.suffix[1:].lower() if out is not None else FORMATS[0]
        if name not in FORMATS:
            raise InputError(f"{out}: which format? Give --format {'|'.join(FORMATS)}, or such a suffix")
    # Captions differ between countries, and so do the files.
    suffix = f".{name}" if country is None else f".{country.code}.{name}"
    if name == "png":
        return FileKind("pictures", suffix, partial(render_png, time=time, country=country))
    if time is not None:
        raise InputError("--time chooses the moment of a PNG; films show the whole episode")
    return FileKind("pictures", suffix, partial(render_gif if name == "gif" else render_mp4, country=country))


def render_png(
    trace: Trace, scene: Scene, path: Path, time: float | None = None, country: Country | None = None
) -> None:
    """One moment: the given one, else the first event that counts against it, else half-way."""
    save_png(path, moment(trace, scene, time, country))


def moment(
    trace: Trace, scene: Scene, time: float | None, country: Country | None = None, under_way: bool = False
) -> Image:
    """The picture of it, (height, width, 3) RGB. under_way: the episode has not ended with the trace."""
    tick = _tick(trace, time)
    ego = trace.snapshots[tick].ego
    around = [(ego.x, ego.y), (ego.x - 35, ego.y - 25), (ego.x + 35, ego.y + 25)]
    sign = scene.target_sign
    if np.hypot(sign.x - ego.x, sign.y - ego.y) <= _PLATE_NEAR_M:
        around.append((sign.x, sign.y))
    return BirdsEye(trace, scene, PNG_SIZE, np.array(around), follow=False, country=country, under_way=under_way).page(
        tick
    )


def _tick(trace: Trace, time: float | None) -> int:
    last = len(trace.snapshots) - 1
    if time is None:
        if not trace.events:
            return last // 2
        time = trace.events[0].start_s
    elif not 0.0 <= time <= trace.snapshots[-1].time + DT_S / 2:
        raise InputError(f"--time {time:g}: the episode lasts from 0 to {trace.snapshots[-1].time:.1f} s")
    return min(round(time / DT_S), last)


def render_scene_png(scene: Scene, path: Path, title: str, country: Country | None = None, map_id: str = "") -> None:
    """A scene without an episode: roads, plates, obstacles, start, convoy, destination, and the ways.

    Blue: the way that navigation gives; green: the obedient way, where it is another one. map_id: what lies around it.
    """
    save_png(path, scene_picture(scene, title, country=country, map_id=map_id))


def scene_picture(
    scene: Scene,
    title: str,
    size: PageSize = PNG_SIZE,
    *,
    country: Country | None = None,
    map_id: str = "",
    beside: Scene | None = None,
) -> Image:
    """The picture of a scene, (height, width, 3) RGB. beside: the other half, whose picture has the same frame."""
    ways = list(way_shapes(scene, LaneGraph(scene.network)))
    staged = list(start_shapes(scene))
    page = np.full((size.height, size.width, 3), STYLE.panel, dtype=np.uint8)
    view = page[size.header_px : size.height - size.footer_px]
    view[:] = STYLE.ground
    camera = _camera(scene, np.concatenate([_points(half) for half in (scene, beside or scene)]), size)
    roads = (*ground_shapes(map_id), *road_shapes(scene.network, scene))
    paint(view, camera, (*roads, *ways, *furniture_shapes(scene, country), *staged))
    draw_scale_bar(view, camera.scale)
    draw_attribution(view)
    facts = scene_facts(scene, country)
    subtitle = f"sign {facts['sign']} · horizon {facts['time']}"
    page[: size.header_px] = header(size, title, subtitle, scene.target_sign, country=country)
    _legend(page[size.height - size.footer_px :], {s.colour for s in ways} | {s.kind for s in staged})
    return page


def _camera(scene: Scene, points: Array, size: PageSize) -> Camera:
    """Over all points and the target plate, whose size in metres depends on the scale."""
    sign, found = scene.target_sign, points
    away, clear = way_off(scene.network, sign)
    for _ in range(2):
        camera = camera_over(found, size.width, size.view_height, _MARGIN_M, _SCALES)
        reach = 1.5 * plate_px(camera) / camera.scale - _MARGIN_M + clear
        found = np.vstack((points, (sign.x, sign.y) + max(reach, 0.0) * away * (1.0, -1.0)))
    return camera


def _points(scene: Scene) -> Array:
    """What a picture shows: all plates, the ways, and who is there at the start."""
    goal = scene.network.edge_lanes(scene.destination.edge)[0].line.point_at(scene.destination.s)
    alone = [*((s.x, s.y) for s in scene.signs), *((body.x, body.y) for body in start_shapes(scene)), goal]
    return np.concatenate((alone, *(way.points for way in way_shapes(scene, LaneGraph(scene.network)))))


def _legend(footer: Image, shown: set[str]) -> None:
    x = 12
    for name, text in _LEGEND.items():
        if name in shown or name in _ALWAYS:
            footer[24:36, x : x + 12] = getattr(STYLE, name)
            x = write(footer, x + 18, 21, text, 13, STYLE.ink) + 22
