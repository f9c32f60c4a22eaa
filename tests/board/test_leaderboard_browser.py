"""The leaderboard in headless Chromium, on a desk and on a telephone: sorted, drawn, played, nothing too wide."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from browsing import PHONE, opened, until
from submitted import edition

from tsbench.board.players import copy_traces
from tsbench.board.site import build_site
from tsbench.board.submission import Submission
from tsbench.episode.perception_level import load_level

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

DESKTOP = (1280, 900)
SIZES = pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
LONG = "A planner with a name as long as anybody's, in version 12.4.1 of the winter"


@pytest.fixture(scope="module")
def site(driven: Path, honest: Callable[..., Submission], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three planners, a floor among them; one at three levels, with failures to watch at one."""
    base = tmp_path_factory.mktemp("board")
    idm = honest("idm", title=LONG)
    named = replace(idm.planner, name="ground", floor=True)
    made = {
        "idm": idm, "expert": honest("idm-e", title="Expert"), "ground": replace(idm, title="Ground", planner=named),
        "good": replace(idm, perception=load_level("good")), "poor": replace(idm, perception=load_level("poor")),
    }  # fmt: skip
    for name, submission in made.items():
        (base / f"{name}.json").write_text(submission.to_json(), encoding="utf-8")
    copy_traces(driven, idm, base / "idm.json", 3)
    build_site(base, base / "site", players=3)
    return base / "site"


def page_of(site: Path, name: str) -> str:
    (path,) = (p for p in site.glob(f"{name}-*.html") if p.stem.rsplit("-", 1)[0] == name)
    return path.as_uri()


def narrow(page: Page) -> bool:
    """Is nothing wider than the screen? Tables may be, in boxes of their own that are scrolled."""
    return bool(page.evaluate("document.documentElement.scrollWidth <= innerWidth"))


# Of all texts of curves: the least height, px, and the greatest right end.
TEXTS = """() => {
  const boxes = [...document.querySelectorAll(".curves svg text")].map((text) => text.getBoundingClientRect());
  return [Math.min(...boxes.map((box) => box.height)), Math.max(...boxes.map((box) => box.right))];
}"""


@SIZES
def test_the_index_is_sorted_and_floors_stay_below(chromium: Browser, site: Path, size: tuple[int, int]) -> None:
    with opened(chromium, (site / "index.html").as_uri(), "table.board", size) as page:
        assert narrow(page)
        first = page.locator("table.board").first
        names = first.locator("tbody tr:not(.head) th a")
        assert names.all_inner_texts() == ["Expert", LONG, "Ground"]
        head = first.locator("th button", has_text="paired SCD")
        head.click()
        assert first.locator("th[aria-sort]").get_attribute("aria-sort") == "descending"
        assert names.all_inner_texts() == ["Expert", LONG, "Ground"]
        head.click()
        assert first.locator("th[aria-sort]").get_attribute("aria-sort") == "ascending"
        assert names.all_inner_texts() == [LONG, "Expert", "Ground"]
        assert first.locator("tbody.floors tr").first.inner_text().startswith("Floors")
        assert first.locator("tbody.floors tr").last.is_visible()
        assert narrow(page)


@SIZES
def test_curves_are_seen_and_told(chromium: Browser, site: Path, size: tuple[int, int]) -> None:
    for url in ((site / "index.html").as_uri(), page_of(site, "idm")):
        with opened(chromium, url, ".curves svg", size) as page:
            drawn = page.locator(".curves svg")
            assert drawn.count() == 1
            assert drawn.is_visible()
            assert drawn.get_attribute("role") == "img"
            said = drawn.get_attribute("aria-label") or ""
            assert all(f"{level} " in said for level in ("exact", "good", "poor", "floor"))
            least, right = page.evaluate(TEXTS)
            assert least >= 9.0
            assert right <= size[0]
            # Every level stands below its value.
            assert {"exact", "good", "poor"} <= set(page.locator(".curves svg text").all_text_contents())


@pytest.fixture
def watched(chromium: Browser, site: Path, request: pytest.FixtureRequest) -> Iterator[Page]:
    with opened(chromium, page_of(site, "idm"), "#episode-table tbody tr", request.param, "dark") as page:
        yield page


@pytest.mark.parametrize("watched", [DESKTOP, PHONE], ids=["desktop", "phone"], indirect=True)
def test_a_failure_is_played(watched: Page) -> None:
    page = watched
    assert narrow(page)
    assert page.locator("#submissions tbody tr").count() == 3
    page.locator("#episode-table button.play").first.click()
    until(page, "tsb.player.episode !== null")
    assert page.locator("#player").is_visible()
    told = page.inner_text("#player-verdict")
    assert "violated the sign" in told or "obeyed what" in told or "·" in told
    box = page.locator("#player").bounding_box()
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= page.evaluate("innerWidth")
    page.keyboard.press("ArrowRight")
    # The link names the episode and the submission that it is of.
    assert f"{edition()}%2C%20dev%2C%20exact" in page.url
    page.keyboard.press("Escape")
    assert page.locator("#player").is_hidden()


def test_a_planner_without_traces_has_no_player(chromium: Browser, site: Path) -> None:
    with opened(chromium, page_of(site, "idm-e"), "#submissions", PHONE) as page:
        assert page.locator("#player").count() == 0
        assert narrow(page)
