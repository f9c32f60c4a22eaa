"""Pictures of the site for docs/install.md: packaging/site_pictures.py SITE FOLDER, or `make site-pictures`."""

from __future__ import annotations

import shutil
import sys
from contextlib import AbstractContextManager
from functools import partial
from http.server import SimpleHTTPRequestHandler
from pathlib import Path
from typing import TYPE_CHECKING, Any

from serving import serving

if TYPE_CHECKING:
    from playwright.sync_api import Browser

DESKTOP, PHONE = (1280, 800), (390, 844)
# By name of the picture: the page, and the window that shows it, in pixels.
PICTURES = {
    "site-desktop.png": ("reference/commands.html", DESKTOP),
    "site-phone.png": ("reference/tables.html", PHONE),
}


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: Any) -> None:
        """What was asked for is not of interest."""


def served(site: Path) -> AbstractContextManager[str]:
    """The address of a site's folder, served on this machine: its search works only so."""
    return serving(partial(_Quiet, directory=str(site)))


def take_pictures(browser: Browser, address: str, folder: Path) -> None:
    """All of PICTURES, as PNG into the folder."""
    for name, (page_name, (width, height)) in PICTURES.items():
        context = browser.new_context(viewport={"width": width, "height": height}, color_scheme="light")
        page = context.new_page()
        page.goto(f"{address}/{page_name}", wait_until="networkidle")
        page.screenshot(path=folder / name)
        context.close()


def main(site: Path, folder: Path) -> None:
    """Open the site in Chromium and take its pictures."""
    from playwright.sync_api import sync_playwright

    program = shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        sys.exit("no chromium on this machine (apt-get install chromium)")
    with sync_playwright() as tool, served(site) as address:
        browser = tool.chromium.launch(executable_path=program, args=["--no-sandbox", "--disable-gpu"])
        take_pictures(browser, address, folder)
        browser.close()


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
