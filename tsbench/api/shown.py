"""What a notebook shows of an episode: a player, and a frame of it."""

from __future__ import annotations

import html
from base64 import b64encode
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from urllib.parse import quote

from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.episode.trace import Trace
from tsbench.report.drawing.paint import png_bytes
from tsbench.report.page.report_page import episode_page
from tsbench.report.scene_pictures import moment
from tsbench.run.log.read import StoredRun
from tsbench.run.options import keywords, path_of
from tsbench.scenarios.scene_loader import load_scene

_HEIGHT_PX = 720


class Picture(bytes):
    """The bytes of a PNG file. A notebook shows the picture, and a terminal tells its size."""

    def __repr__(self) -> str:
        width, height = (int.from_bytes(self[at : at + 4]) for at in (16, 20))
        return f"Picture({width} x {height} px, {len(self) / 1000:.0f} kB of PNG)"

    def __str__(self) -> str:
        return repr(self)

    def _repr_png_(self) -> bytes:
        return bytes(self)


@dataclass(frozen=True, repr=False)
class Shown:
    """An episode; the last value of a notebook's cell is shown as a player.

    time: s, of the frame and where the player begins; None: the first event that counts against it.
    """

    run: StoredRun
    trace: Trace
    time: float | None = None

    @cached_property
    def page(self) -> str:
        """The player with all its data as one page of HTML."""
        return episode_page(self.run, self.trace.planner, self.trace.spec.scenario_id)

    @cached_property
    def frame(self) -> Picture:
        """The picture of one moment, PNG. Raises InputError for a time outside of the episode."""
        with keywords():
            return Picture(png_bytes(moment(self.trace, load_scene(self.run.data, self.trace.spec), self.time)))

    def save(self, path: str | Path) -> Path:
        """Write the frame (a path that ends in .png) or else the player's page."""
        target = path_of("path", path)
        content = self.frame if target.suffix == ".png" else self.page.encode()
        with io_errors_as_input_errors(target):
            write_atomic(target, content)
        return target

    def __repr__(self) -> str:
        name = f"{self.trace.planner}/{self.trace.spec.scenario_id}"
        return f"Shown({name}: a player in a notebook; .frame is a picture, .save(path) writes a PNG or an HTML page)"

    def _repr_html_(self) -> str:
        at = "" if self.time is None else f"&t={self.time:g}"
        name = quote(f"{self.trace.planner}/{self.trace.spec.scenario_id}", safe="")
        # A document of its own with an address of its own: the player keeps its time in that.
        source = f"data:text/html;base64,{b64encode(self.page.encode()).decode()}#play={name}{at}"
        return f'<iframe src="{html.escape(source)}" width="100%" height="{_HEIGHT_PX}" style="border:0"></iframe>'

    def _repr_png_(self) -> bytes:
        return self.frame
