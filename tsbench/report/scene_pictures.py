"""Pictures and films of episodes and scenes as files: PNG, GIF, MP4. No display is needed.

MP4 is in real time, GIF at half the frame rate.
"""

from __future__ import annotations

import shlex
import subprocess
from collections.abc import Iterable, Iterator
from dataclasses import astuple
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image as PilImage

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, replacing
from tsbench.episode.trace import Trace
from tsbench.geometry.polyline import Array
from tsbench.report.drawing.birds_eye import BirdsEye
from tsbench.report.drawing.canvas import STYLE, VIOLATION_SHADE, Camera, Image, PageSize, camera_over
from tsbench.report.drawing.hud import draw_attribution, draw_scale_bar, header
from tsbench.report.drawing.paint import paint, plate_px, save_png, write
from tsbench.report.drawing.road_shapes import ground_shapes, road_shapes
from tsbench.report.drawing.scene_shapes import furniture_shapes, named_from, start_shapes, way_off, way_shapes
from tsbench.report.episode_files import FileKind, Played
from tsbench.report.wording import scene_facts
from tsbench.roads.lane_graph import LaneGraph
from tsbench.scenarios.spec import SIGNED
from tsbench.signs.countries import Country
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S

VIDEO_SIZE = PageSize(800, 680, strip_px=80)
GIF_SIZE = PageSize(640, 520)
GIF_EVERY = 2
HOLD_S = 1.5
# A short film stops where the rule is broken.
_STOP_S = 2.5
# Off the post so much room for its plate.
_PLATE_M = 9.0
_NEAR_M, _LEAST_PX_PER_M = 60.0, 5.0
_GIF_COLOURS = 128
_CLEAR = 255
# A frame does not fit into a pipe; the largest that an unprivileged process may have saves most of the waiting.
_PIPE_BYTES = 1 << 20
# One thread for each film: films are many, and threads that wait for each other cost more than they bring. A fixed
# quantiser spares x264 the look at each frame in advance. OpenCV converts colours as the standard for small pictures
# says, which players do not guess alike.
_ENCODER = shlex.split(
    "-c:v libx264 -preset ultrafast -qp 18 -threads 1 -filter_threads 1 -fps_mode passthrough -movflags +faststart "
    "-x264-params colormatrix=smpte170m:colorprim=smpte170m:transfer=smpte170m"
)
_GIF: dict[str, Any] = {"format": "GIF", "save_all": True, "loop": 0, "optimize": False, "disposal": 1}


def film(
    trace: Trace,
    scene: Scene,
    size: PageSize,
    every: int = 1,
    span: tuple[int, int] | None = None,
    country: Country | None = None,
) -> Iterator[Image]:
    """The pages of an episode, each `every` ticks and the last one; one array, drawn into anew.

    span: first and last tick, by default all; such a short film has a camera that stands still.
    """
    around = _around(trace, scene, size, span)
    eye = BirdsEye(trace, scene, size, around, span is None, country)
    page = np.empty((size.height, size.width, 3), dtype=np.uint8)
    for tick in _ticks(trace, every, span):
        yield eye.page(tick, page)


def _ticks(trace: Trace, every: int, span: tuple[int, int] | None) -> list[int]:
    first, last = (0, len(trace.snapshots) - 1) if span is None else span
    return [*range(first, last, every), last]


def _around(trace: Trace, scene: Scene, size: PageSize, span: tuple[int, int] | None) -> Array:
    """What a film shows: the ego's way and the plate; in a short one others too, as far as the ego stays large."""
    first, last = (0, len(trace.snapshots) - 1) if span is None else span
    track = np.array([(s.ego.x, s.ego.y) for s in trace.snapshots[first : last + 1]])
    plates = []
    for sign in scene.target_signs:
        (away, clear), post = way_off(scene.network, sign), np.array((sign.x, sign.y))
        if span is None or np.hypot(*(track - post).T).min() <= _NEAR_M:
            plates += [post, post + (clear + _PLATE_M) * away * (1.0, -1.0)]
    found = track
    if span is None:
        return np.vstack((track, *plates))
    for more in (_named(trace, first, last), np.vstack((track, *plates))):
        wider = np.vstack((found, more))
        if camera_over(wider, size.width, size.view_height, 0.0, (0.0, np.inf)).scale >= _LEAST_PX_PER_M:
            found = wider
    return found


def _named(trace: Trace, first: int, last: int) -> Array:
    """(n, 2): positions of the road users that a violation in these ticks names, when it begins."""
    found = [np.zeros((0, 2))]
    for event in trace.against:
        snapshot = trace.snapshots[min(round(event.start_s / DT_S), len(trace.snapshots) - 1)]
        actors = snapshot.actors
        named = named_from([event], actors.table.ids)
        seen = [actors.table.ids[row] in named for row in actors.index.tolist()]
        if first <= snapshot.step <= last and any(seen):
            found.append(actors.pose[seen, :2])
    return np.concatenate(found)


def render_mp4(trace: Trace, scene: Scene, path: Path, country: Country | None = None) -> None:
    with io_errors_as_input_errors(path), replacing(path) as part:
        _encode(_frames(trace, scene, country), VIDEO_SIZE, part)


def _frames(trace: Trace, scene: Scene, country: Country | None) -> Iterator[Image]:
    """Frames as the encoder takes them; one array, written anew."""
    frame = np.empty((VIDEO_SIZE.height * 3 // 2, VIDEO_SIZE.width), dtype=np.uint8)
    for page in film(trace, scene, VIDEO_SIZE, country=country):
        # OpenCV converts colours three times faster than ffmpeg does.
        cv2.cvtColor(page, cv2.COLOR_RGB2YUV_I420, dst=frame)
        yield frame
    for _ in range(round(HOLD_S / DT_S)):
        yield frame


def _encode(frames: Iterable[Image], size: PageSize, path: Path) -> None:
    import imageio_ffmpeg  # an extra of its own: only films need it

    told = f"-y -nostdin -loglevel error -f rawvideo -pix_fmt yuv420p -s {size.width}x{size.height}"
    given = shlex.split(f"{told} -r {round(1 / DT_S)} -i pipe:0")
    command = [imageio_ffmpeg.get_ffmpeg_exe(), *given, *_ENCODER, "-f", "mp4", str(path)]
    encoder = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, pipesize=_PIPE_BYTES
    )
    with encoder:
        assert encoder.stdin is not None
        try:
            for frame in frames:
                encoder.stdin.write(frame.data)
        except BrokenPipeError:
            # It has given up; why is in what it says below.
            pass
        except BaseException:
            encoder.kill()
            raise
        _, said = encoder.communicate()
    if encoder.returncode:
        reason = " ".join(said.decode(errors="replace").split()) or f"ffmpeg ended with {encoder.returncode}"
        raise InputError(f"{path.parent}: no film could be written there ({reason[-200:]})")


def render_gif(
    trace: Trace,
    scene: Scene,
    path: Path,
    size: PageSize = GIF_SIZE,
    span: tuple[int, int] | None = None,
    country: Country | None = None,
) -> None:
    """The episode, or ticks `span` of it, in real time at half the frame rate and in one palette.

    Of a span, the frame in which a violation begins is held.
    """
    pages = film(trace, scene, size, GIF_EVERY, span, country)
    save_gif(path, pages, _durations(trace, span))


def save_gif(path: Path, pages: Iterable[Image], durations: Iterable[float]) -> None:
    """Write pages as an endless GIF in the palette of the first one. durations: of each page, s. Raises InputError."""
    frames: list[PilImage.Image] = []
    palette: PilImage.Image | None = None
    before: Image | None = None
    for page in pages:
        picture = PilImage.fromarray(page)
        if palette is None:
            palette = _palette(picture)
        indices = np.asarray(picture.quantize(palette=palette, dither=PilImage.Dither.NONE))
        # What has not changed since the page before is left clear: long runs of one index pack well.
        fresh = indices if before is None else np.where(indices == before, _CLEAR, indices).astype(np.uint8)
        before = indices
        frame = PilImage.fromarray(fresh, mode="P")
        frame.putpalette(palette.getpalette() or [])
        frames.append(frame)
    with io_errors_as_input_errors(path), replacing(path) as part:
        times = [round(1000 * s) for s in durations]
        frames[0].save(part, **_GIF, append_images=frames[1:], duration=times, transparency=_CLEAR)


def _durations(trace: Trace, span: tuple[int, int] | None) -> list[float]:
    """Of each frame, s."""
    ticks = _ticks(trace, GIF_EVERY, span)
    found = [DT_S * GIF_EVERY] * (len(ticks) - 1) + [HOLD_S]
    for event in trace.against if span is not None else ():
        shown = next((k for k, tick in enumerate(ticks) if trace.snapshots[tick].time + 1e-6 >= event.start_s), None)
        if shown is not None and trace.snapshots[ticks[0]].time <= event.start_s:
            found[shown] = _STOP_S
    return found


def _palette(first: PilImage.Image) -> PilImage.Image:
    found = first.quantize(_GIF_COLOURS, method=PilImage.Quantize.MEDIANCUT).getpalette() or []
    named = [c for colour in astuple(STYLE) if isinstance(colour, tuple) and len(colour) == 3 for c in colour]
    dark = [round(VIOLATION_SHADE * c) for c in STYLE.violation]
    palette = PilImage.new("P", (1, 1))
    palette.putpalette([*found[: 3 * _GIF_COLOURS], *named, *dark])
    return palette


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
        return FileKind("pictures", suffix, partial(render_png, time=time, country=country), with_other=True)
    if time is not None:
        raise InputError("--time chooses the moment of a PNG; films show the whole episode")
    return FileKind("pictures", suffix, partial(render_gif if name == "gif" else render_mp4, country=country))


def render_png(
    trace: Trace,
    scene: Scene,
    path: Path,
    time: float | None = None,
    country: Country | None = None,
    beside: Played | None = None,
) -> None:
    """One moment: the given one, else the first event that counts against it, else half-way.

    beside: the other half's episode, whose picture of the same moment, or of its end before that, stands beside it; the
    signed half stands on the left.
    """
    pages = [moment(trace, scene, time, country)]
    if beside is not None:
        other, its_scene = beside
        at = trace.snapshots[_tick(trace, time)].time
        pages.append(moment(other, its_scene, min(at, other.snapshots[-1].time), country))
    save_png(path, np.hstack(pages if trace.spec.half == SIGNED else pages[::-1]))


def moment(
    trace: Trace, scene: Scene, time: float | None = None, country: Country | None = None, under_way: bool = False
) -> Image:
    """The picture of it, (height, width, 3) RGB. under_way: the episode has not ended with the trace."""
    tick = _tick(trace, time)
    ego = trace.snapshots[tick].ego
    around = [(ego.x, ego.y), (ego.x - 35, ego.y - 25), (ego.x + 35, ego.y + 25)]
    for sign in scene.target_signs:
        if np.hypot(sign.x - ego.x, sign.y - ego.y) <= _PLATE_NEAR_M:
            around.append((sign.x, sign.y))
    eye = BirdsEye(trace, scene, PNG_SIZE, np.array(around), follow=False, country=country, under_way=under_way)
    return eye.page(tick)


def _tick(trace: Trace, time: float | None) -> int:
    last = len(trace.snapshots) - 1
    if time is None:
        if not trace.against:
            return last // 2
        time = trace.against[0].start_s
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
    roads = (*ground_shapes(scene, map_id), *road_shapes(scene.network, scene))
    paint(view, camera, (*roads, *ways, *furniture_shapes(scene, country), *staged))
    draw_scale_bar(view, camera.scale)
    draw_attribution(view)
    facts = scene_facts(scene, country)
    subtitle = f"sign {facts['sign']} · horizon {facts['time']}"
    page[: size.header_px] = header(size, title, subtitle, scene.target_signs, scene.artwork(country))
    _legend(page[size.height - size.footer_px :], {s.colour for s in ways} | {s.kind for s in staged})
    return page


def _camera(scene: Scene, points: Array, size: PageSize) -> Camera:
    """Over all points and the target plates, whose size in metres depends on the scale."""
    found = points
    posts = [(np.array((sign.x, sign.y)), *way_off(scene.network, sign)) for sign in scene.target_signs]
    for _ in range(2):
        camera = camera_over(found, size.width, size.view_height, _MARGIN_M, _SCALES)
        reach = 1.5 * plate_px(camera) / camera.scale - _MARGIN_M
        ends = [post + max(reach + clear, 0.0) * away * (1.0, -1.0) for post, away, clear in posts]
        found = np.vstack((points, *ends))
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
