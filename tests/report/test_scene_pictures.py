"""Pictures: the right colours at the right places, whole files, clear errors."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import cv2
import episode_builders as made
import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image as PilImage
from run_builders import episode, make_run

from tsbench.cli.episodes import render as command
from tsbench.core.errors import InputError
from tsbench.episode.outcome import EpisodeFacts, Outcome
from tsbench.episode.trace import Trace, read_trace, trace_path, write_trace
from tsbench.report.drawing.birds_eye import BirdsEye
from tsbench.report.drawing.canvas import STYLE, VIOLATION_SHADE, PageSize, camera_at, camera_over
from tsbench.report.drawing.paint import label, paint, shorten, text_width, wrap
from tsbench.report.drawing.scene_shapes import staged_bodies, start_shapes
from tsbench.report.scene_pictures import film, picture_kind, render_png, render_scene_png, scene_picture
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.signs.countries import load_country
from tsbench.sim.scene import Obstacle, Scene, SceneFile

SIZE = PageSize(640, 480)
CONES = Obstacle("o", "cones", 150.0, -4.8, 0.0, 5.0, 0.5, "east_0")


def an_episode(violated: bool = True) -> EpisodeFacts:
    egos = [made.ego(60.0 + k, speed=10.0) for k in range(61)]
    others = [
        made.Track("car", made.straight(61, 100.0, 1.6, math.pi, 5.0)),
        made.Track("bus", made.straight(61, 80.0, -1.6, 0.0, 8.0), made.ActorKind.BUS, (12.0, 2.5)),
        made.Track("walker", made.straight(61, 110.0, -8.0, 0.0, 1.0), made.ActorKind.PEDESTRIAN, (0.4, 0.4)),
    ]
    target = made.verdict(made.violation(3.0, x=90.0, y=-4.8)) if violated else made.verdict()
    return made.facts(egos, others, outcome=Outcome.COLLISION, target=target, world=made.scene((CONES,)))


@pytest.fixture
def trace(tmp_path: Path) -> Trace:
    path = trace_path(tmp_path / "run", "idm", made.spec().scenario_id)
    write_trace(path, made.result(an_episode()))
    return read_trace(path)


# SUMO's vehicles of the scene: only the one that waits is drawn as a car at the start.
STAGED = """<additional>
 <vType id="long" length="6" width="2"/>
 <vehicle id="waiting_0" type="long" departLane="1" departPos="53"><route edges="east"/></vehicle>
 <vehicle id="bg_000" type="long" departLane="0" departPos="80"><route edges="east"/></vehicle>
 <vehicle id="ego" type="long" departLane="0" departPos="20"><route edges="east"/></vehicle>
 <vehicle id="o" type="long" departLane="0" departPos="150"><route edges="east"/></vehicle>
</additional>"""


@pytest.fixture
def scene() -> Scene:
    return replace(made.scene((CONES,)), additional=SceneFile(Path("scene.xml"), STAGED.encode()))


def bird(trace: Trace, scene: Scene) -> BirdsEye:
    return BirdsEye(trace, scene, SIZE, np.array([(60.0, 0.0), (120.0, -8.0)]), follow=False)


def colour_at(eye: BirdsEye, page: np.ndarray, x: float, y: float) -> tuple[int, ...]:
    px = eye._ground_camera.px([(x, y)])[0]
    pixel = page[STYLE.header_px + round(px[1]), round(px[0])]
    return tuple(int(v) for v in pixel)


def test_the_plan_of_a_tick_is_drawn(trace: Trace, scene: Scene) -> None:
    plans = [None] * len(trace.snapshots)
    plans[10] = np.array([(80.0, -11.0), (95.0, -11.0)], dtype=np.float32)
    plans[11] = np.array([(80.0, -11.0)], dtype=np.float32)
    eye = bird(replace(trace, plans=tuple(plans)), scene)
    for tick, drawn in ((9, False), (10, True), (11, False)):
        assert (colour_at(eye, eye.page(tick), 88.0, -11.0) == STYLE.plan) == drawn, tick


def test_colours_are_where_things_are(trace: Trace, scene: Scene) -> None:
    eye = bird(trace, scene)
    page = eye.page(20)
    assert page.shape == (480, 640, 3)
    ego = trace.snapshots[20].ego
    assert colour_at(eye, page, ego.x - 1.0, ego.y) == STYLE.ego
    assert colour_at(eye, page, ego.x + 0.9, ego.y) == STYLE.glass
    assert colour_at(eye, page, 70.0, -4.8) == STYLE.trail
    assert colour_at(eye, page, 105.0, -4.8) == STYLE.route
    assert colour_at(eye, page, 97.0, -3.9) == STYLE.asphalt
    assert colour_at(eye, page, 100.0, 12.0) == STYLE.ground
    assert colour_at(eye, page, 100.0 - 10.0 + 1.0, 1.6) == STYLE.car
    assert colour_at(eye, page, 96.0 - 3.0, -1.6) == STYLE.bus
    assert colour_at(eye, page, 112.0, -8.0) == STYLE.pedestrian


def test_north_is_up_and_places_are_exact() -> None:
    camera = camera_at(10.0, 20.0, 4.0, 200, 100)
    assert camera.px([(10.0, 20.0)])[0] == pytest.approx((99.5, 49.5))
    assert camera.px([(11.0, 21.0)])[0] == pytest.approx((103.5, 45.5))
    part = camera.window(40, 30, 50, 50)
    assert part.px([(10.0, 20.0)])[0] == pytest.approx((59.5, 19.5))
    points = np.array([(0.0, 0.0), (30.0, 5.0)])
    over = camera_over(points, 300, 200, 1.0, (0.1, 50.0))
    assert (over.px(points) >= 0).all()
    assert (over.px(points) <= (300, 200)).all()


def test_the_violation_appears_when_it_happens(trace: Trace, scene: Scene) -> None:
    eye = bird(trace, scene)
    calm = tuple(round(VIOLATION_SHADE * c) for c in STYLE.violation)
    before, after = eye.page(29).copy(), eye.page(31)
    assert tuple(before[-10, 5]) == STYLE.panel
    assert tuple(int(v) for v in after[-10, 5]) == calm
    ring = (90.0, -4.8 + 4.0)
    assert colour_at(eye, before, *ring) != STYLE.violation
    assert colour_at(eye, after, *ring) == STYLE.violation


def test_the_plate_stands_right_of_its_post(trace: Trace, scene: Scene) -> None:
    eye = bird(trace, scene)
    page = eye.page(0)
    # The traffic faces east, so right is down; the frame and the red rim are below the post at y = -8.
    px = eye._ground_camera.px([(100.0, -8.0)])[0]
    below = page[STYLE.header_px + round(px[1]) : STYLE.header_px + round(px[1]) + 60, round(px[0])].astype(int)
    assert (np.abs(below - STYLE.plate_line).sum(axis=1) < 20).any()
    assert ((below[:, 0] > 150) & (below[:, 1] < 60) & (below[:, 2] < 60)).any()


def test_png_of_the_violation_and_of_a_moment(trace: Trace, scene: Scene, tmp_path: Path) -> None:
    for name, time in (("a", None), ("b", 1.0)):
        render_png(trace, scene, tmp_path / f"{name}.png", time)
    a, b = (np.asarray(PilImage.open(tmp_path / f"{n}.png")) for n in "ab")
    assert a.shape == b.shape == (1050, 1400, 3)
    assert a[-10, 5, 0] > 2 * b[-10, 5, 0]
    with pytest.raises(InputError, match=r"lasts from 0 to 6\.0 s"):
        render_png(trace, scene, tmp_path / "c.png", 60.0)


@pytest.mark.slow
def test_mp4_is_the_whole_episode(trace: Trace, scene: Scene, tmp_path: Path) -> None:
    picture_kind("mp4", None).write(trace, scene, tmp_path / "a.mp4")
    video = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    frames = []
    while True:
        more, frame = video.read()
        if not more:
            break
        frames.append(frame[..., ::-1])
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(10.0)
    assert len(frames) == 61 + 15
    assert frames[0].shape == (680, 800, 3)
    assert np.abs(frames[0][5, 400].astype(int) - STYLE.panel).max() < 12
    # The ego moves to the right of the picture or the world to its left: frames differ.
    assert np.abs(frames[0].astype(int) - frames[60]).mean() > 1.0


def test_gif_is_the_whole_episode(trace: Trace, scene: Scene, tmp_path: Path) -> None:
    picture_kind("gif", None).write(trace, scene, tmp_path / "a.gif")
    picture = PilImage.open(tmp_path / "a.gif")
    assert picture.n_frames == 31
    picture.seek(30)
    last = np.asarray(picture.convert("RGB")).astype(int)
    dark = np.array([round(VIOLATION_SHADE * c) for c in STYLE.violation])
    assert np.abs(last[-10, 5] - dark).max() < 12
    with pytest.raises(InputError, match="moment of a PNG"):
        picture_kind("gif", None, time=1.0)


def test_a_long_way_is_followed(scene: Scene, tmp_path: Path) -> None:
    egos = [made.ego(10.0 + 1.5 * k, speed=15.0) for k in range(240)]
    write_trace(tmp_path / "t", made.result(made.facts(egos, world=scene)))
    trace = read_trace(tmp_path / "t")
    for k, page in enumerate(film(trace, scene, SIZE, every=60)):
        # While it drives, the ego stays in the middle of the view.
        middle = page[STYLE.header_px + SIZE.view_height // 2, 320 - 8 : 320 + 8].astype(int)
        assert (np.abs(middle - STYLE.ego).sum(axis=1) < 20).any(), k


def test_an_episode_without_violation_shows_its_middle(scene: Scene, tmp_path: Path) -> None:
    write_trace(tmp_path / "t", made.result(an_episode(violated=False)))
    render_png(read_trace(tmp_path / "t"), scene, tmp_path / "a.png")
    assert tuple(np.asarray(PilImage.open(tmp_path / "a.png"))[-10, 5]) == STYLE.panel


def test_scene_picture(scene: Scene, tmp_path: Path) -> None:
    picture = scene_picture(scene, "a title " * 60)
    codes = np.unique(picture.reshape(-1, 3).astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], dtype=np.uint32))
    seen = {(c >> 16, c >> 8 & 255, c & 255) for c in codes.tolist()}
    assert {STYLE.asphalt, STYLE.ground, STYLE.marking, STYLE.ego, STYLE.destination, STYLE.route, STYLE.cone} <= seen
    # The legend holds colours too, so what stands there is looked for above it.
    view = picture[STYLE.header_px : -STYLE.footer_px]
    for colour in (STYLE.ego, STYLE.car, STYLE.cone, STYLE.destination):
        assert (view == colour).all(axis=2).any(), colour
    render_scene_png(scene, tmp_path / "new" / "scene.png", "title")
    assert PilImage.open(tmp_path / "new" / "scene.png").size == (1400, 1050)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="File exists"):
        render_scene_png(scene, tmp_path / "file" / "scene.png", "title")


def test_who_waits_at_the_start_is_drawn(scene: Scene) -> None:
    (car,) = staged_bodies(scene)
    lane = scene.network.lane("east_1")
    assert (car.kind, car.length, car.width) == ("car", 6.0, 2.0)
    assert (car.x, car.y) == pytest.approx(lane.line.point_at(50.0 * lane.line.length / lane.length))
    camera = camera_at(car.x, car.y, 10.0, 200, 200)
    page = np.zeros((200, 200, 3), dtype=np.uint8)
    paint(page, camera, start_shapes(scene))
    assert tuple(page[100, 85]) == STYLE.car


def test_labels_lie_on_any_ground() -> None:
    text = label("20 m", 12, STYLE.outline, STYLE.marking)
    for ground in (0, 255):
        page = np.full((40, 80, 3), ground, dtype=np.uint8)
        text.lay(page, 4, 4)
        assert np.array_equal(page[:4], np.full((4, 80, 3), ground))
        inside = page[4:30, 4:70].reshape(-1, 3).astype(int)
        for colour in (STYLE.outline, STYLE.marking):
            assert (np.abs(inside - colour).max(axis=1) <= 2).any()


def test_a_country_changes_the_caption_only(trace: Trace, scene: Scene) -> None:
    country = load_country("de")
    around = np.array([(60.0, 0.0), (120.0, -8.0)])
    eyes = [BirdsEye(trace, scene, SIZE, around, follow=False, country=c) for c in (None, country)]
    pages = [eye.page(10) for eye in eyes]
    pictures = [scene_picture(scene, "title", SIZE, country=c) for c in (None, country)]
    for own, foreign in (pages, pictures):
        rows = np.flatnonzero((own != foreign).any(axis=(1, 2)))
        assert rows.size
        assert rows.max() < STYLE.header_px


@pytest.fixture
def run(tmp_path: Path, trace: Trace, scene: Scene, monkeypatch: pytest.MonkeyPatch) -> Path:
    name = trace.spec.scenario_id
    records = [episode(planner, 0, 0, 0, scenario_id=name) for planner in ("idm", "my.py:P")]
    folder = make_run(tmp_path / "made", records)
    (tmp_path / "run" / "traces").rename(folder / "traces")
    write_trace(trace_path(folder, "my.py:P", name), made.result(an_episode(), planner="my.py:P"))
    monkeypatch.setattr(SceneLoader, "load", lambda *_: (scene, None))
    return folder


def call(*arguments: object) -> tuple[str, BaseException | None]:
    result = CliRunner().invoke(command, [str(a) for a in arguments])
    return result.output, result.exception


def test_the_command(run: Path, tmp_path: Path) -> None:
    output, error = call(run, f"idm/{made.spec().scenario_id}")
    assert error is None
    assert Path(output.strip()) == run / "pictures" / "idm" / "speed_limit-000-0.png"
    assert Path(output.strip()).stat().st_size > 10_000
    _, error = call(run, f"idm/{made.spec().scenario_id}", "--out", tmp_path / "x.gif")
    assert error is None
    assert PilImage.open(tmp_path / "x.gif").format == "GIF"


def test_the_command_with_wrong_names(run: Path, tmp_path: Path) -> None:
    for arguments, words in (
        ((tmp_path / "nowhere", "e"), "no run folder"),
        ((run, "other"), "no episode 'other'; there are idm/speed_limit-000-0"),
        ((run, "idm/other"), "no episode 'idm/other'"),
        ((run, made.spec().scenario_id, "--out", tmp_path / "x.bmp"), "which format"),
        ((run, f"idm/{made.spec().scenario_id}", "--time", "-1"), "lasts from 0"),
    ):
        _, error = call(*arguments)
        assert isinstance(error, InputError)
        assert words in str(error)


def test_an_episode_of_several_planners_must_be_named(run: Path) -> None:
    _, error = call(run, made.spec().scenario_id)
    assert isinstance(error, InputError)
    assert "idm/speed_limit-000-0, my.py:P/speed_limit-000-0" in str(error)
    output, error = call(run, f"my.py:P/{made.spec().scenario_id}")
    assert error is None
    assert "my.py%3AP" in output


def test_text_is_fitted() -> None:
    assert shorten("short", 13, 500) == "short"
    short = shorten("a long text " * 20, 13, 200)
    assert short.endswith("…")
    assert text_width(short, 13) <= 200
    rows = wrap("many words here " * 20, 13, 200, 2)
    assert len(rows) == 2
    assert rows[1].endswith("…")
    assert all(text_width(r, 13) <= 200 for r in rows)
    assert wrap("", 13, 200, 2) == [""]
