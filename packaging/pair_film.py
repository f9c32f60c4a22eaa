"""Draws the film at the top of README.md: one pair, its halves side by side, a row for each planner.

python packaging/pair_film.py RUN PAIR OUT.gif PLANNER... (or `make film`)

RUN has episodes of these planners on both halves of PAIR.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tsbench.episode.outcome import Outcome
from tsbench.episode.trace import Trace
from tsbench.geometry.polyline import Array
from tsbench.planners import registry
from tsbench.report.drawing.birds_eye import BirdsEye
from tsbench.report.drawing.canvas import STYLE, Colour, Image, PageSize
from tsbench.report.drawing.paint import paste, text_width, write
from tsbench.report.scene_pictures import save_gif
from tsbench.run.log.read import read_run
from tsbench.run.run_traces import Traces
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import load_scene
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.signs.plates import plate_rgba
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S

SPLIT = "dev"
# A picture each 0.3 s of driving, shown for 0.1 s. One with a new verdict is shown for longer, and so is the last.
_EVERY, _SHOWN_S, _VERDICT_S, _HOLD_S = 3, 0.1, 0.8, 4.0
_SIZE = PageSize(440, 270 + STYLE.header_px + STYLE.compact_footer_px)
_GAP_PX, _HEAD_PX, _PLATE_PX, _TITLE_PX, _BADGE_PX = 8, 92, 80, 30, 30
_ROW_PX = _TITLE_PX + _SIZE.view_height + _GAP_PX
# The camera shows traffic within so many metres of the target plate.
_NEAR_M = 21.0


def main(run: str, pair: str, out: str, *planners: str) -> None:
    """Draw the film of these planners, one row each, in their order."""
    halves = [row for row in DataSet().table(SPLIT) if row.pair_id == pair]
    scenes = [load_scene(DataSet(), row) for row in halves]
    kept = Traces(read_run(Path(run)))
    traces = [[kept.read(planner, row.scenario_id) for row in halves] for planner in planners]
    pages, durations = zip(*film(halves, scenes, traces), strict=True)
    save_gif(Path(out), pages, durations)
    print(f"{out}: {sum(durations):.0f} s, {Path(out).stat().st_size / 1e6:.2f} MB")


def film(
    halves: Sequence[ScenarioSpec], scenes: Sequence[Scene], traces: Sequence[Sequence[Trace]]
) -> Iterator[tuple[Image, float]]:
    """Its pictures and for how many seconds each is shown. Columns are halves, rows planners: `traces[row][column]`."""
    around, size = _around(scenes[0], traces), (_ROW_PX * len(traces), _left(len(halves)))
    page = np.full((_HEAD_PX + size[0], size[1], 3), STYLE.panel, dtype=np.uint8)
    for column, half in enumerate(halves):
        _head(page[:_HEAD_PX, _left(column) :], half)
    panels = [
        _Panel(
            page[_HEAD_PX + row * _ROW_PX + _TITLE_PX :, _left(column) :][: _SIZE.view_height, : _SIZE.width],
            BirdsEye(trace, scenes[column], _SIZE, around, follow=False, named=False),
        )
        for row, driven in enumerate(traces)
        for column, trace in enumerate(driven)
    ]
    last = max(panel.last for panel in panels)
    before = 0
    for tick in [*range(0, last, _EVERY), last]:
        for row, driven in enumerate(traces):
            _title(page[_HEAD_PX + row * _ROW_PX :][:_TITLE_PX], driven, tick)
        verdicts = sum([panel.draw(tick) for panel in panels])
        shown = _HOLD_S if tick == last else _SHOWN_S if verdicts == before else _VERDICT_S
        before = verdicts
        yield page.copy(), shown


class _Panel(NamedTuple):
    """One episode at its place in the page."""

    view: Image
    eye: BirdsEye

    @property
    def last(self) -> int:
        return len(self.eye.trace.snapshots) - 1

    def draw(self, tick: int) -> bool:
        """Draw the episode at a tick, or its end where that is earlier, and say whether there is a verdict."""
        page = self.eye.page(min(tick, self.last))
        self.view[:] = page[_SIZE.header_px : -_SIZE.footer_px]
        text, ground, ink = _verdict(self.eye.trace, tick)
        if text:
            self.view[:_BADGE_PX, : text_width(text, 17, True) + 20] = ground
            write(self.view, 10, 4, text, 17, ink, bold=True)
        return bool(text)


def _left(column: int) -> int:
    return _GAP_PX + column * (_SIZE.width + _GAP_PX)


def _around(scene: Scene, traces: Sequence[Sequence[Trace]]) -> Array:
    """(n, 2): where the egos and other traffic are near the target plate."""
    snapshots = [snapshot for row in traces for trace in row for snapshot in trace.snapshots]
    egos = np.array([(snapshot.ego.x, snapshot.ego.y) for snapshot in snapshots])
    others = [snapshot.actors.pose[:, :2] for snapshot in snapshots]
    post = np.array((scene.target_signs[0].x, scene.target_signs[0].y))
    found = np.vstack((post, egos, *others))
    near: Array = found[np.hypot(*(found - post).T) <= _NEAR_M]
    return near


def _head(head: Image, half: ScenarioSpec) -> None:
    """The plate of a half, and what it is called."""
    artwork = DataSet().artwork()
    plate = plate_rgba(artwork, half.sign_code, half.sign_value, _PLATE_PX)
    paste(head, 0, 6, plate[..., :3], plate[..., 3])
    name = artwork.catalog.sign(half.sign_code).name_en
    write(head, _PLATE_PX + 14, 18, name, 24, STYLE.ink, bold=True)
    write(head, _PLATE_PX + 14, 52, f"sign {half.sign_code}, {half.half} half", 15, STYLE.faint)


def _title(bar: Image, driven: Sequence[Trace], tick: int) -> None:
    """Who drives a row; at the right the time, and once all halves are over, how many were passed."""
    bar[:] = STYLE.panel
    planner = driven[0].planner
    entry = registry.entry(planner)
    x = write(bar, _GAP_PX, 4, planner, 18, STYLE.ink, bold=True)
    sees = "sees signs" if entry.sign_access else "sees no signs"
    write(bar, x + 12, 6, f"{entry.kind}, {sees}", 15, STYLE.faint)
    text, colour = f"{tick * DT_S:.0f} s", STYLE.faint
    if all(tick >= len(trace.snapshots) - 1 for trace in driven):
        passed = sum(not trace.against and trace.outcome == Outcome.ARRIVED for trace in driven)
        won = passed == len(driven)
        text = f"{passed} of {len(driven)} halves: pair {'passed' if won else 'failed'}"
        colour = STYLE.destination if won else STYLE.violation
    write(bar, bar.shape[1] - _GAP_PX - text_width(text, 17, True), 4, text, 17, colour, bold=True)


def _verdict(trace: Trace, tick: int) -> tuple[str, Colour, Colour]:
    """What can be said of an episode at a tick, its ground and its ink; "" where it is too early."""
    begun = [event for event in trace.against if event.start_s <= tick * DT_S + 1e-6]
    if begun and begun[0] in trace.verdicts.needless:
        return "needless", STYLE.plate_line, STYLE.panel
    if begun:
        return "violated", STYLE.violation, STYLE.ink
    if tick < len(trace.snapshots) - 1:
        return "", STYLE.panel, STYLE.ink
    if trace.outcome == Outcome.ARRIVED:
        return "obeyed, arrived", STYLE.destination, STYLE.panel
    return str(trace.outcome), STYLE.plate_line, STYLE.panel


if __name__ == "__main__":
    main(*sys.argv[1:])
