"""Pictures of a built leaderboard for the docs: `leaderboard_pictures.py SITE FOLDER` (`make board`)."""

from __future__ import annotations

import io
import sys
from pathlib import Path

from browsing import PHONE, browser, opened
from PIL import Image

DESK = (1280, 900)
_COLOURS = 128


def make(site: Path, folder: Path, planner: str = "plant2-ft") -> list[Path]:
    """The index and a planner's page on a desk, the index and a curve on a telephone."""
    (own,) = (path for path in site.glob(f"{planner}-*.html") if path.stem.rsplit("-", 1)[0] == planner)
    index, page = (site / "index.html").as_uri(), own.as_uri()
    shots = {
        "leaderboard": (index, "table.board", DESK, "light"),
        "leaderboard-phone-dark": (index, "table.board", PHONE, "dark"),
        "leaderboard-curves": (f"{index}#curves", ".curves svg", DESK, "light"),
        "leaderboard-planner": (page, "#submissions", DESK, "light"),
        "leaderboard-curve-phone": (f"{page}#perception", ".curves svg", PHONE, "light"),
    }
    made = []
    with browser() as chromium:
        if chromium is None:
            sys.exit("no chromium on this machine (apt-get install chromium)")
        for name, (url, ready, size, scheme) in shots.items():
            with opened(chromium, url, ready, size, scheme) as shown:
                if size == DESK and "#" in url:
                    shown.locator(".curves").first.scroll_into_view_if_needed()
                    shown.evaluate("scrollBy(0, 200)")
                picture = Image.open(io.BytesIO(shown.screenshot())).convert("RGB")
            made.append(folder / f"{name}.png")
            # A palette: a third of the bytes, and nobody sees it.
            picture.quantize(_COLOURS, dither=Image.Dither.NONE).save(made[-1], optimize=True)
    return made


if __name__ == "__main__":
    for path in make(Path(sys.argv[1]).resolve(), Path(sys.argv[2])):
        print(path)
