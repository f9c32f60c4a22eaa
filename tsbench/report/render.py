"""Pictures and films of episodes and scenes as files: PNG, GIF, MP4. No display is needed."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from PIL import Image as PilImage

from tsbench.errors import InputError
from tsbench.geometry.polyline import Array
from tsbench.report.bev import BirdsEye, PageSize
from tsbench.report.bulk import Job, Progress, Tally, make_files
from tsbench.report.camera import Image, camera_over
from tsbench.report.films import render_gif, render_mp4
from tsbench.report.furniture import draw_furniture, draw_way
from tsbench.report.hud import draw_attribution, draw_scale_bar
from tsbench.report.lettering import paste, shorten, write
from tsbench.report.outfile import whole_file
from tsbench.report.roads import draw_roads
from tsbench.report.selection import Chosen, Selection, select_traces
from tsbench.report.staging import draw_start, staged_cars, walker_places
from tsbench.report.style import STYLE
from tsbench.run.trace import Trace, find_trace, read_trace
from tsbench.scenarios.load import load_scene
from tsbench.signs.countries import Country, shown_code
from tsbench.signs.plates import plate_rgba
from tsbench.sim.lanegraph import LaneGraph
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S

FORMATS = ("png", "gif", "mp4")
PNG_SIZE = PageSize(1400, 1050)
_PLATE_NEAR_M = 90.0


def render_episode(
    run: Path,
    episode: str,
    kind: str | None,
    out: Path | None,
    time: float | None,
    country: Country | None = None,
) -> Path:
    """Draw an episode of a run folder; returns the file.

    kind: one of FORMATS, by default what the suffix of `out` says, else png; country: whose code the caption
    gives the sign. Raises InputError.
    """
    if kind is None:
        kind = out.suffix[1:].lower() if out is not None else FORMATS[0]
        if kind not in FORMATS:
            raise InputError(f"{out}: which format? Give --format {'|'.join(FORMATS)}, or such a suffix")
    source = find_trace(run, episode)
    trace = read_trace(source)
    path = _picture_path(run / "pictures", source, kind, country) if out is None else out
    render(trace, load_scene(trace.spec), kind, path, time, country)
    return path


def render_selection(
    run: Path,
    selection: Selection,
    kind: str,
    out: Path | None,
    workers: int,
    progress: Progress,
    country: Country | None = None,
) -> tuple[Tally, Chosen]:
    """Draw all selected episodes of a run below the folder `out` (default: RUN/pictures) that are not drawn yet."""
    chosen = select_traces(run, selection)
    folder = run / "pictures" if out is None else out
    jobs = [Job(trace, _picture_path(folder, trace, kind, country)) for trace in chosen.traces]
    return make_files(jobs, partial(_draw, kind=kind, country=country), workers, progress), chosen


def _draw(trace: Trace, path: Path, kind: str, country: Country | None) -> None:
    render(trace, load_scene(trace.spec), kind, path, country=country)


def _picture_path(folder: Path, trace: Path, kind: str, country: Country | None) -> Path:
    """PLANNER/SCENARIO[.COUNTRY].KIND: captions differ between countries, and so do the files."""
    code = "" if country is None else f".{country.code}"
    return folder / trace.parent.name / f"{trace.stem}{code}.{kind}"


def render(
    trace: Trace,
    scene: Scene,
    kind: str,
    path: Path,
    time: float | None = None,
    country: Country | None = None,
) -> None:
    """Draw an episode. kind: png | gif | mp4; time (s): the moment of a PNG."""
    if kind == "png":
        render_png(trace, scene, path, time, country)
        return
    if time is not None:
        raise InputError("--time chooses the moment of a PNG; films show the whole episode")
    if kind == "gif":
        render_gif(trace, scene, path, country=country)
    else:
        render_mp4(trace, scene, path, country)


def render_png(
    trace: Trace, scene: Scene, path: Path, time: float | None = None, country: Country | None = None
) -> None:
    """One moment: the given one, else the first violation of the target, else half-way."""
    tick = _tick(trace, time)
    ego = trace.snapshots[tick].ego
    around = [(ego.x, ego.y), (ego.x - 35, ego.y - 25), (ego.x + 35, ego.y + 25)]
    sign = scene.target_sign
    if np.hypot(sign.x - ego.x, sign.y - ego.y) <= _PLATE_NEAR_M:
        around.append((sign.x, sign.y))
    picture = BirdsEye(trace, scene, PNG_SIZE, np.array(around), follow=False, country=country).page(tick)
    _save(path, PilImage.fromarray(picture))


def _tick(trace: Trace, time: float | None) -> int:
    last = len(trace.snapshots) - 1
    if time is None:
        if not trace.target.violations:
            return last // 2
        time = min(v.start_s for v in trace.target.violations)
    elif not 0.0 <= time <= trace.snapshots[-1].time + DT_S / 2:
        raise InputError(f"--time {time:g}: the episode lasts from 0 to {trace.snapshots[-1].time:.1f} s")
    return min(round(time / DT_S), last)


def render_scene_png(scene: Scene, path: Path, title: str, country: Country | None = None) -> None:
    """A scene without an episode: roads, plates, obstacles, start, convoy, destination, and the ways.

    Blue: the way that navigation gives; green: the obedient way, where it is another one.
    """
    _save(path, PilImage.fromarray(scene_picture(scene, title, country=country)))


def scene_picture(
    scene: Scene, title: str, size: PageSize = PNG_SIZE, country: Country | None = None
) -> Image:
    """The picture of `render_scene_png`, (height, width, 3) RGB."""
    graph = LaneGraph(scene.network)
    page = np.empty((size.height, size.width, 3), dtype=np.uint8)
    view = page[STYLE.header_px : size.height - STYLE.footer_px]
    camera = camera_over(_scene_points(scene, graph), size.width, size.view_height, 14.0, (1.5, 12.0))
    draw_roads(view, camera, scene.network)
    if scene.compliant_hint and scene.compliant_hint != scene.route_hint:
        draw_way(view, camera, scene, graph, scene.compliant_hint, STYLE.compliant, -0.4)
    draw_way(view, camera, scene, graph, scene.route_hint, STYLE.route, 0.4 if scene.compliant_hint else 0.0)
    draw_furniture(view, camera, scene, plate_px=round(min(max(4.5 * camera.scale, 30), 60)))
    draw_start(view, camera, scene)
    draw_scale_bar(view, camera.scale)
    draw_attribution(view)
    _caption(page, scene, title, country)
    return page


def _scene_points(scene: Scene, graph: LaneGraph) -> Array:
    """What a picture of the scene must show, (n, 2)."""
    network, start = scene.network, scene.start
    lane = network.lane(start.lane)
    points = [lane.line.point_at(start.s), (scene.target_sign.x, scene.target_sign.y)]
    points.append(network.edge_lanes(scene.destination.edge)[0].line.point_at(scene.destination.s))
    points += [(car.x, car.y) for car in staged_cars(scene)] + walker_places(scene)
    for edges in (scene.route_hint, scene.compliant_hint):
        path = graph.path(edges, lane.index, start.s, scene.destination) if edges else None
        if path is not None:
            points += [(float(x), float(y)) for x, y in path.line.points[path.line.s <= path.destination_s]]
    return np.array(points)


def _caption(page: Image, scene: Scene, title: str, country: Country | None) -> None:
    width, sign = page.shape[1], scene.target_sign
    top = page.shape[0] - STYLE.footer_px
    page[: STYLE.header_px] = STYLE.panel
    page[top:] = STYLE.panel
    size = STYLE.header_px - 12
    plate = plate_rgba(sign.code, sign.value, size)
    paste(page, 12, 6, plate[..., :3], plate[..., 3])
    value = "" if sign.value is None else f", {sign.value:g}"
    write(page, size + 24, 10, shorten(title, 18, width - size - 48), 18, STYLE.ink, bold=True)
    facts = f"sign {shown_code(sign.code, country)}{value} on edge {sign.edge} at {sign.position_m:.0f} m"
    facts += f" · horizon {scene.horizon * DT_S:.0f} s"
    write(page, size + 24, 36, shorten(facts, 13, width - size - 48), 13, STYLE.faint)
    legend = [
        ("ego at its start", STYLE.ego),
        ("destination", STYLE.destination),
        ("navigation's way", STYLE.route),
    ]
    if scene.compliant_hint and scene.compliant_hint != scene.route_hint:
        legend.append(("obedient way", STYLE.compliant))
    if scene.convoy is not None:
        legend.append(("convoy, held until the ego comes", STYLE.convoy))
    if any(not car.held for car in staged_cars(scene)):
        legend.append(("car that waits or leads", STYLE.car))
    if scene.walkers is not None:
        legend.append(("pedestrians, held until the ego comes", STYLE.pedestrian))
    legend.append(("line of the plate", STYLE.plate_line))
    x = 12
    for text, colour in legend:
        page[top + 24 : top + 36, x : x + 12] = colour
        x = write(page, x + 18, top + 21, text, 13, STYLE.ink) + 22


def _save(path: Path, picture: PilImage.Image) -> None:
    with whole_file(path) as part:
        picture.save(part, format="PNG", compress_level=4)
