"""The documentation in headless Chromium, served as a reader serves it: on a desktop and on a phone."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import pytest
from patience import HANG_S
from scripts import load_script

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

ROOT = Path(__file__).resolve().parents[2]
# How much wider than its window a page is, px.
TOO_WIDE = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
BROKEN = "[...document.images].filter(i => !i.naturalWidth).map(i => i.src)"


@pytest.fixture(scope="module")
def pictures() -> ModuleType:
    return load_script("site_pictures")


@pytest.fixture(scope="module")
def address(site: Path, pictures: ModuleType) -> Iterator[str]:
    with pictures.served(site) as where:
        yield where


@contextmanager
def window(browser: Browser, address: str, size: tuple[int, int]) -> Iterator[Page]:
    """A window in which nothing may go wrong and which may ask only the site's own server."""
    context = browser.new_context(viewport={"width": size[0], "height": size[1]})
    page = context.new_page()
    page.set_default_timeout(1_000 * HANG_S)
    problems: list[str] = []
    asked: list[str] = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("console", lambda said: problems.append(said.text) if said.type in ("error", "warning") else None)
    page.on("response", lambda got: problems.append(f"{got.status} {got.url}") if got.status >= 400 else None)
    page.on("request", lambda request: asked.append(request.url))
    yield page
    context.close()
    assert problems == []
    assert [u for u in asked if not u.startswith((address, "data:", "blob:"))] == []


@pytest.mark.parametrize("device", ["DESKTOP", "PHONE"])
def test_search_leads_to_a_page(chromium: Browser, address: str, pictures: ModuleType, device: str) -> None:
    with window(chromium, address, getattr(pictures, device)) as page:
        page.goto(f"{address}/index.html")
        if device == "PHONE":
            page.locator("label[for=__search].md-header__button").click()
        field = page.locator(".md-search__input")
        field.click()
        field.press_sequentially("held stop")
        found = page.locator(".md-search-result__link").first
        found.wait_for(state="visible")
        found.click()
        page.wait_for_url(lambda url: "/index.html" not in url)
        assert "stop" in page.locator("article").inner_text().lower()


def test_every_page_fits_a_desktop_and_a_phone(
    chromium: Browser, site: Path, address: str, pictures: ModuleType
) -> None:
    problems = {}
    names = sorted(path.relative_to(site).as_posix() for path in site.rglob("*.html"))
    with window(chromium, address, pictures.DESKTOP) as page:
        for name in names:
            for width, height in (pictures.DESKTOP, pictures.PHONE):
                page.set_viewport_size({"width": width, "height": height})
                if width == pictures.DESKTOP[0]:
                    page.goto(f"{address}/{name}")
                if (excess := page.evaluate(TOO_WIDE)) > 0:
                    problems[name, width] = f"{excess} px too wide"
            if broken := page.evaluate(BROKEN):
                problems[name, "pictures"] = broken
    assert problems == {}


def test_the_menu_opens_on_a_phone_and_stands_beside_the_text_on_a_desktop(
    chromium: Browser, address: str, pictures: ModuleType
) -> None:
    with window(chromium, address, pictures.PHONE) as page:
        page.goto(f"{address}/rules.html")
        menu = page.locator(".md-sidebar--primary")
        assert not menu.is_visible() or menu.bounding_box()["x"] < 0
        page.locator("label[for=__drawer].md-header__button").click()
        page.get_by_text("How to", exact=True).last.wait_for(state="visible")
    with window(chromium, address, pictures.DESKTOP) as page:
        page.goto(f"{address}/rules.html")
        assert page.evaluate(TOO_WIDE) <= 0
        text = page.locator("article").bounding_box()
        menu = page.locator(".md-sidebar--primary").bounding_box()
        assert menu["x"] + menu["width"] <= text["x"]


def test_pictures_of_the_site_are_taken(chromium: Browser, address: str, pictures: ModuleType, tmp_path: Path) -> None:
    pictures.take_pictures(chromium, address, tmp_path)
    for name in pictures.PICTURES:
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
        assert (ROOT / "docs/images" / name).is_file()
