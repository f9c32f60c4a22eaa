"""The page in headless Chromium: opened from disk, filtered, played with the keyboard, on a phone, in the dark."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import browsing
import page_runs
import pytest
from browsing import DESKTOP, PHONE, until
from page_runs import HOSTILE, SENTENCE, TRACED
from patience import HANG_S
from test_page_report import write
from test_page_server import served, under_way

import tsbench
from tsbench.report.page.report_page import write_report
from tsbench.run.log.journal import JOURNAL, encode
from tsbench.scenarios.data_set import DataSet

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return page_runs.make_run(tmp_path_factory.mktemp("browsed") / "run")


@pytest.fixture(scope="module")
def report(run: Path) -> Path:
    return write(run)[0].path


opened = partial(browsing.opened, ready="#episode-table tbody tr")


@contextmanager
def playing(
    browser: Browser, report: Path, episode: str = f"idm/{TRACED[0]}", time: float | None = None, **how: Any
) -> Iterator[Page]:
    """The page of a report with the player of an episode open. time: s, where it stands."""
    at = "" if time is None else f"&t={time}"
    with opened(browser, f"{report.as_uri()}#play={quote(episode, safe='')}{at}", **how) as page:
        until(page, "tsb.player.episode !== null")
        yield page


# All colours of a canvas, as "r,g,b".
COLOURS = """id => {
  const canvas = document.getElementById(id), seen = new Set();
  const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  for (let k = 0; k < data.length; k += 4) seen.add(`${data[k]},${data[k + 1]},${data[k + 2]}`);
  return [...seen];
}"""


def until_drawn(page: Page, canvas: str, colours: set[str]) -> None:
    """Wait for colours on a canvas."""
    for _ in range(int(HANG_S / 0.1)):
        if colours <= set(page.evaluate(COLOURS, canvas)):
            return
        page.wait_for_timeout(100)
    pytest.fail(f"never on {canvas}: {colours - set(page.evaluate(COLOURS, canvas))}")


# Place and scale of both cameras.
CAMERAS = "tsb.player.cameras.map(({ x, y, scale }) => [x, y, scale])"


def rows(page: Page) -> int:
    return page.locator("#episode-table tbody tr").count()


def test_it_opens_from_disk_and_names_are_text(chromium: Browser, report: Path) -> None:
    with opened(chromium, report.as_uri()) as page:
        assert page.title().startswith("idm, <img src=x")
        assert page.locator("main img[src='x']").count() == 0
        assert page.locator("#summary tbody th", has_text=HOSTILE).count() >= 1
        assert page.locator("figure svg").count() >= 2
        assert "96 of 96 episodes" in page.inner_text("#episode-table .count")
        page.select_option("#episode-table-planner", HOSTILE)
        assert "48 of 96 episodes" in page.inner_text("#episode-table .count")
        page.select_option("#episode-table-violation_clause", "over_limit")
        assert rows(page) == 1
        assert SENTENCE in page.inner_text("#episode-table tbody")
        page.fill("#episode-table-map_id", "map-9")
        assert rows(page) == 0
        page.click("#episode-table button:text('clear')")
        page.click("#episode-table th[data-name='violation_time_s'] button")
        page.click("#episode-table th[data-name='violation_time_s'] button")
        assert page.get_attribute("#episode-table th[data-name='violation_time_s']", "aria-sort") == "descending"
        assert "over_limit" in page.inner_text("#episode-table tbody tr:first-child")


def test_what_happened_is_read_without_scrolling(chromium: Browser, report: Path) -> None:
    with opened(chromium, report.as_uri(), size=(1400, 900)) as page:
        shown = page.locator("#episode-table th[data-name='told']").bounding_box()
        around = page.locator("#episode-table").bounding_box()
        assert shown["x"] + shown["width"] <= around["x"] + around["width"]


# Of all texts of charts that are shown: the least height, px, and the greatest right end.
TEXTS = """() => {
  const texts = [...document.querySelectorAll("figure svg text")];
  const boxes = texts.map((text) => text.getBoundingClientRect()).filter((box) => box.width);
  return [Math.min(...boxes.map((box) => box.height)), Math.max(...boxes.map((box) => box.right))];
}"""


def test_charts_are_legible_on_a_phone(chromium: Browser, report: Path) -> None:
    for size, shown, hidden in ((PHONE, "stacked", "wide"), (DESKTOP, "wide", "stacked")):
        with opened(chromium, report.as_uri(), size=size) as page:
            assert page.locator(f"#intervals figure.{shown} svg").is_visible()
            assert page.locator(f"#intervals figure.{hidden} svg").is_hidden()
            least, right = page.evaluate(TEXTS)
            assert least >= 9.0
            assert right <= size[0]


def test_a_cell_of_the_heat_map_filters(chromium: Browser, report: Path) -> None:
    with opened(chromium, report.as_uri()) as page:
        page.click("#types td.share a >> nth=0")
        assert "24 of 96 episodes" in page.inner_text("#episode-table .count")


def test_the_player_by_keyboard(chromium: Browser, report: Path) -> None:
    with playing(chromium, report, time=1.0) as page:
        assert page.evaluate("tsb.player.tick") == pytest.approx(10)
        # What was packed is where it was: the ego drives at 10 m/s from x = 60 m.
        assert page.evaluate("tsb.player.episode.track.x[40]") == pytest.approx(100.0, abs=0.03)
        assert page.evaluate("tsb.player.episode.parts.length") == 4
        page.keyboard.press("ArrowRight")
        assert page.evaluate("tsb.player.tick") == pytest.approx(11)
        page.keyboard.press("Shift+ArrowRight")
        assert page.evaluate("tsb.player.tick") == pytest.approx(21)
        page.keyboard.press("v")
        assert page.evaluate("tsb.player.tick") == pytest.approx(30)
        assert "3.0 s · 36 km/h" in page.inner_text("#player-clock")
        told = page.inner_text("#player-verdict")
        assert SENTENCE in told
        assert "54.1 km/h" in told
        assert "41.0 km/h" in told
        page.keyboard.press("Home")
        page.keyboard.press(" ")
        assert page.evaluate("tsb.player.playing") is True
        until(page, "tsb.player.tick > 3")
        page.keyboard.press(" ")
        assert page.evaluate("tsb.player.playing") is False
        page.keyboard.press("End")
        assert page.evaluate("tsb.player.tick") == 60
        page.keyboard.press("n")
        until(page, f"tsb.player.episode?.scenario === '{TRACED[1]}'")
        assert "obeyed the sign" in page.inner_text("#player-verdict")
        page.keyboard.press("Escape")
        assert not page.locator("#player").is_visible()


def test_an_episode_is_seen_whole_and_plays_when_it_is_opened(chromium: Browser, report: Path) -> None:
    """Verdict and controls beside the map; the next failure by its key, past what was passed."""
    with playing(chromium, report) as page:
        for name in ("player-view", "player-verdict", "player-play"):
            box = page.locator(f"#{name}").bounding_box()
            assert box["y"] + box["height"] <= DESKTOP[1], name
        title = page.inner_text("#player-title")
        page.keyboard.press("]")
        until(page, f"document.getElementById('player-title').innerText !== {title!r}")
        # That of the other planner: what this one passed is left out.
        assert page.evaluate("tsb.player.episode.scenario") == TRACED[0]
    with playing(chromium, report, motion="no-preference") as page:
        until(page, "tsb.player.playing")


def test_the_view_is_drawn_and_the_violation_marked(chromium: Browser, report: Path) -> None:
    with playing(chromium, report, time=3.0) as page:
        # Ego, asphalt, violation, the oncoming car: colours of report/drawing/canvas.py.
        until_drawn(page, "player-view", {"255,112,32", "86,91,99", "228,30,45", "160,200,235"})
        until_drawn(page, "player-line", {"192,21,37"})  # the violation on the time line


def test_lights_and_names_of_others(chromium: Browser, report: Path) -> None:
    """The bus turns left: an amber lamp; from 3.0 s on a sentence names it."""
    for start, named in ((2.9, False), (3.1, True)):
        with playing(chromium, report, time=start) as page:
            lamp, ink = "255,190,40", "240,242,245"
            if named:
                until_drawn(page, "player-view", {lamp, ink})
            else:
                # Out of sight until the moment of the violation.
                until_drawn(page, "player-view", {"255,112,32"})
                assert not {lamp, ink} & set(page.evaluate(COLOURS, "player-view"))


def test_the_legend_is_open_where_there_is_room(chromium: Browser, report: Path) -> None:
    for size, shown in ((DESKTOP, True), (PHONE, False)):
        with playing(chromium, report, size=size) as page:
            assert page.is_visible("#player-legend") is shown
            told = page.text_content("#player-legend") or ""
            assert "indicator" in told
            assert "brakes" in told


def test_curves_beside_the_speed_where_there_is_room(chromium: Browser, report: Path) -> None:
    for size, shown in ((DESKTOP, True), (PHONE, False)):
        with playing(chromium, report, time=3.0, size=size) as page:
            assert page.is_checked("#player-curves") is shown
            heights = []
            for wanted in (True, False):
                page.set_checked("#player-curves", wanted)
                until_drawn(page, "player-line", {"192,21,37"})
                box = page.locator("#player-line").bounding_box()
                heights.append(box["height"])
            assert heights[0] > 2 * heights[1]
            # The ego keeps its speed, and nobody is in its way.
            for name, value in (("a", 0), ("steer", 0), ("ttc", None)):
                assert page.evaluate(f"tsb.player.episode.track.{name}") == [value] * 61


def test_a_phone_in_the_dark(chromium: Browser, report: Path) -> None:
    with playing(chromium, report, f"{HOSTILE}/{TRACED[0]}", size=PHONE, scheme="dark") as page:
        assert HOSTILE in page.inner_text("#player-title")
        box = page.locator("#player").bounding_box()
        assert box["width"] <= 390
        page.click("#player-close")
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        dark = page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert dark == "rgb(20, 23, 27)"
        page.click("#theme")
        assert page.evaluate("document.documentElement.dataset.theme") == "light"
        assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(251, 251, 249)"


def test_a_served_run_fetches_what_it_plays(chromium: Browser, run: Path) -> None:
    played = f"#play={quote(f'{HOSTILE}/{TRACED[0]}', safe='')}"
    with served(run) as port, opened(chromium, f"http://127.0.0.1:{port}/run/0/{played}") as page:
        until(page, "tsb.player.episode !== null")
        assert SENTENCE in page.inner_text("#player-verdict")
        until(page, "[...document.querySelectorAll('#player-plate')].every(i => i.naturalWidth > 0)")


def test_the_page_of_a_run_that_goes_on_loads_its_new_episodes(chromium: Browser, tmp_path: Path) -> None:
    made = page_runs.make_run(tmp_path / "run")
    lines, journal = under_way(made), made / JOURNAL
    journal.write_bytes(encode({"run": "this"}) + b"".join(lines[:3]))
    with served(made) as port, opened(chromium, f"http://127.0.0.1:{port}/run/0/") as page:
        until(page, "!document.getElementById('live').hidden")
        assert page.inner_text("#live") == "The run goes on: 3 of 96 episodes are finished."
        journal.write_bytes(encode({"run": "this"}) + b"".join(lines[:7]))
        page.get_by_text("The run goes on: 7 of 96 episodes").wait_for()
        page.get_by_text("of 7 episodes can be played").wait_for()


def test_two_planners_drive_one_scene_side_by_side(chromium: Browser, report: Path) -> None:
    with playing(chromium, report) as page:
        assert page.evaluate("tsb.player.halves.map((one) => one.planner)") == ["idm"]
        # Of those that drove this scene: the other planner, by a name that stays text.
        assert page.locator("#player-beside option").all_inner_texts() == ["the other half", HOSTILE]
        page.select_option("#player-beside", HOSTILE)
        until(page, "tsb.player.halves.length === 2")
        assert page.evaluate("tsb.player.halves.map((one) => one.planner)") == ["idm", HOSTILE]
        assert page.evaluate("tsb.player.halves.map((one) => one.scenario)") == [TRACED[0]] * 2
        assert page.inner_text("#player-verdict").startswith("idm: ")
        assert page.inner_text("#player-2-verdict").startswith(f"{HOSTILE}: ")
        page.select_option("#player-beside", "")
        until(page, "tsb.player.halves.length === 1")


@pytest.fixture(scope="module")
def paired(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = page_runs.make_pair_run(tmp_path_factory.mktemp("paired") / "my run")
    return write(run)[0].path


def test_pairs_are_filtered_by_what_was_passed(chromium: Browser, paired: Path) -> None:
    with opened(chromium, paired.as_uri()) as page:
        for told, count in (("both", 92), ("only signed", 2), ("only contrast", 2)):
            page.select_option("#episode-table-passes", told)
            assert f"{count} of 96 episodes" in page.inner_text("#episode-table .count")
        assert page.locator("#episode-table th[data-name='partner']").count() == 0
        # The heat map's cell of one half filters that half.
        page.locator("#types tr", has_text="contrast SCD").locator("td.share a").first.click()
        assert "24 of 96 episodes" in page.inner_text("#episode-table .count")
        assert page.input_value("#episode-table-half") == "contrast"


def test_both_halves_are_played_in_step(chromium: Browser, paired: Path) -> None:
    slow, broken = TRACED
    with playing(chromium, paired, f"idm/{slow}-c", time=1.0) as page:
        # The signed half is the left one, whichever was opened.
        assert page.evaluate("tsb.player.halves.map((half) => half.scenario)") == [slow, f"{slow}-c"]
        assert page.evaluate("tsb.player.episode.scenario") == f"{slow}-c"
        assert "speed_limit, signed half" in page.inner_text("#player-title")
        assert "speed_limit, contrast half" in page.inner_text("#player-2-title")
        assert "signed half: obeyed the sign" in page.inner_text("#player-verdict")
        assert "contrast half: obeyed what the sign does not ask" in page.inner_text("#player-2-verdict")
        left, right = (page.locator(f"#{name}").bounding_box() for name in ("player-view", "player-2-view"))
        assert (left["y"], left["width"]) == (right["y"], right["width"])
        page.keyboard.press("v")
        assert page.evaluate("tsb.player.tick") == pytest.approx(30)
        assert page.inner_text("#player-clock") == "3.0 s · 36 | 36 km/h"
        # One time axis: the shorter half stands at its end.
        page.keyboard.press("End")
        assert page.evaluate("tsb.player.tick") == 90
        until_drawn(page, "player-view", {"255,112,32"})
        until_drawn(page, "player-2-line", {"192,21,37"})
        assert page.locator("#player-alone").is_hidden()
        # The next one of the list is another pair, of which one half alone has a trace.
        page.keyboard.press("n" if page.is_enabled("#player-next") else "p")
        until(page, f"tsb.player.episode?.scenario === '{broken}'")
        assert page.evaluate("tsb.player.halves.length") == 1
        assert page.locator("#player-half-2").is_hidden()
        assert f"tsbench view '{paired.parent}' drives it again" in page.inner_text("#player-alone")


def test_a_camera_takes_the_other_along(chromium: Browser, paired: Path) -> None:
    with playing(chromium, paired) as page:
        before = page.evaluate(CAMERAS)
        page.hover("#player-2-view")
        page.mouse.wheel(0, -400)
        until(page, f"({CAMERAS})[0][2] > {before[0][2]} * 1.5")
        first, second = page.evaluate(CAMERAS)
        assert first == second


def test_the_rows_of_a_square_are_played_side_by_side(chromium: Browser, tmp_path: Path) -> None:
    run = tmp_path / "run"
    tsbench.evaluate("idm", split="two-signs", types="limit_and_yield", limit=4, workers=1, trace="all", out=run)
    ids = [row.scenario_id for row in DataSet().table("two-signs") if row.pair_type == "limit_and_yield"][:4]
    written = write_report(
        [run], None, allow_partial=False, max_mb=20.0, workers=1, progress=lambda done, of: None
    ).path
    with playing(chromium, written, f"idm/{ids[2]}") as page:
        until(page, "tsb.player.halves.length === 4")
        assert page.evaluate("tsb.player.halves.map((one) => one.scenario)") == ids
        assert page.evaluate("tsb.player.episode.scenario") == ids[2]
        heads = [page.inner_text(f"#player{end}-title") for end in ("", "-2", "-3", "-4")]
        assert [head.partition(", ")[2] for head in heads] == [
            "both signs", "the first sign's contrast plate", "the last sign's contrast plate", "both contrast plates",
        ]  # fmt: skip
        boxes = [page.locator(f"#player{end}-view").bounding_box() for end in ("", "-2", "-3", "-4")]
        (a, b, c, d) = ((round(box["x"]), round(box["y"])) for box in boxes if box)
        assert (a[1], c[1], a[0], b[0]) == (b[1], d[1], c[0], d[0])
