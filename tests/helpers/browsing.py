"""Pages in headless Chromium. A plugin of `tests/conftest.py`: the fixture `chromium`."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest
from patience import HANG_S

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

DESKTOP, PHONE = (1400, 900), (390, 844)


@contextmanager
def browser() -> Iterator[Browser | None]:
    """Debian's Chromium; None where there is none."""
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        yield None
        return
    from playwright.sync_api import sync_playwright

    with sync_playwright() as tool:
        started = tool.chromium.launch(executable_path=program, args=["--no-sandbox", "--disable-gpu"])
        yield started
        started.close()


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """CI installs it, so there it may not be missing."""
    with browser() as started:
        if started is None and os.environ.get("CI"):
            pytest.fail("no chromium: .ci/run installs it")
        if started is None:
            pytest.skip("no chromium on this machine (apt-get install chromium)")
        yield started


@contextmanager
def opened(
    browser: Browser,
    url: str,
    ready: str,
    size: tuple[int, int] = DESKTOP,
    scheme: str = "light",
    motion: str = "reduce",
) -> Iterator[Page]:
    """A page that may ask only for itself and its own server; errors in it fail the test. ready: selects what is
    waited for. motion: a player plays by itself with "no-preference" alone."""
    context = browser.new_context(
        viewport={"width": size[0], "height": size[1]}, color_scheme=scheme, reduced_motion=motion
    )
    page = context.new_page()
    page.set_default_timeout(1_000 * HANG_S)
    problems: list[str] = []
    asked: list[str] = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("console", lambda said: problems.append(said.text) if said.type == "error" else None)
    page.on("request", lambda request: asked.append(request.url))
    page.goto(url)
    page.wait_for_selector(ready)
    yield page
    context.close()
    assert problems == []
    home = url.split("#")[0]
    allowed = ("data:", home if home.startswith("file:") else "http://127.0.0.1")
    assert [u for u in asked if not u.startswith(allowed)] == []


def until(page: Page, expression: str) -> None:
    """Wait for an expression; Playwright's own way needs eval, which the page's policy forbids."""
    for _ in range(int(HANG_S / 0.1)):
        if page.evaluate(expression):
            return
        page.wait_for_timeout(100)
    pytest.fail(f"never: {expression}")
