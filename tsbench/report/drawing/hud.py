"""What is written around a picture: who drives, time and speed, what was violated, scale, attribution."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from tsbench.report.drawing.camera import Image
from tsbench.report.drawing.style import ATTRIBUTION, STYLE, VIOLATION_SHADE
from tsbench.report.drawing.text import (
    label,
    line_height,
    paste,
    shorten,
    stamp,
    text_width,
    tile,
    wrap,
    write,
)
from tsbench.rules.base import Violation
from tsbench.signs.annotations import SignInstance
from tsbench.signs.countries import Country
from tsbench.signs.plates import plate_rgba

_BAR_PX = 5
_PAD_PX = 12
_CLOCK_PX = 190
_KEY_PX = 10
# Fields of `Style` and what they are in a picture, by how much one wants to know it.
LEGEND = {
    "ego": "ego", "route": "navigation's way", "trail": "driven", "convoy": "held for the ego", "pedestrian": "person",
    "bicycle": "bicycle", "bus": "bus", "car": "car", "plate_line": "target plate, its line",
    "destination": "destination", "plan": "planner's plan",
}  # fmt: skip
_ALWAYS = ("ego", "route", "trail", "plate_line", "destination")


@dataclass(frozen=True, slots=True)
class FrameInfo:
    """What the header and the footer say. event: the latest violation; progress: 0-1 of the episode."""

    time: float
    speed: float
    progress: float
    event: Violation | None
    outcome: str


def header(
    width: int,
    title: str,
    subtitle: str,
    sign: SignInstance,
    spare_px: int = 0,
    country: Country | None = None,
) -> Image:
    """A picture's head: plate (a country's), title and what is below it. spare_px: kept free at the right."""
    height, pad = STYLE.header_px, _PAD_PX
    image = np.full((height, width, 3), STYLE.panel, dtype=np.uint8)
    size = height - 12
    plate = plate_rgba(sign.code, sign.value, size, country)
    paste(image, pad, 6, plate[..., :3], plate[..., 3])
    x = pad + size + pad
    room = width - x - spare_px - 2 * pad
    write(image, x, 10, shorten(title, 18, room - pad), 18, STYLE.ink, bold=True)
    write(image, x, 36, shorten(subtitle, 13, room), 13, STYLE.faint)
    return image


class Hud:
    """Header and footer of pages of one episode; the parts that never change are drawn once."""

    def __init__(
        self, width: int, title: str, subtitle: str, sign: SignInstance, events: list[float],
        kinds: Collection[str] = (), country: Country | None = None,
    ) -> None:  # fmt: skip
        """events: moments of violations as shares (0-1) of the episode. kinds: of bodies to be seen (`Body.kind`)."""
        self._width = width
        self._legend = [(name, text) for name, text in LEGEND.items() if name in _ALWAYS or name in kinds]
        self._events = events
        self._header = header(width, title, subtitle, sign, _CLOCK_PX, country)
        self._footers: dict[tuple[Violation | None, str], Image] = {}

    def header(self, page: Image, moment: FrameInfo) -> None:
        height = STYLE.header_px
        page[:height] = self._header
        right = self._width - _PAD_PX
        self._number(page, right - _CLOCK_PX, f"{moment.time:5.1f}", "s")
        speed = f"{3.6 * moment.speed:.0f}"
        width = text_width("km/h", 14) + 4 + sum(_digit(sign).shape[1] for sign in speed)
        self._number(page, right - width, speed, "km/h")

    @staticmethod
    def _number(page: Image, x: int, text: str, unit: str) -> None:
        for sign in text:
            x = stamp(page, x, 12, _digit(sign))
        stamp(page, x + 4, 23, tile(unit, 14, STYLE.faint, STYLE.panel))

    def footer(self, page: Image, moment: FrameInfo) -> None:
        """Write the footer into the bottom of a page: the time line, and the violation or the outcome."""
        key = (moment.event, moment.outcome)
        if key not in self._footers:
            self._footers[key] = self._draw_footer(moment)
        top = page.shape[0] - STYLE.footer_px
        page[top:] = self._footers[key]
        done = round(moment.progress * self._width)
        page[top : top + _BAR_PX, :done] = STYLE.faint
        for share in self._events:
            x = min(round(share * self._width), self._width - 4)
            page[top : top + _BAR_PX, max(x - 2, 0) : x + 3] = STYLE.violation

    def _draw_footer(self, moment: FrameInfo) -> Image:
        image = np.empty((STYLE.footer_px, self._width, 3), dtype=np.uint8)
        event, pad = moment.event, _PAD_PX
        image[:] = (
            STYLE.panel if event is None else tuple(round(VIOLATION_SHADE * c) for c in STYLE.violation)
        )
        image[:_BAR_PX] = (60, 66, 74)
        right = self._width - pad
        if moment.outcome:
            word = moment.outcome.replace("_", " ")
            right -= text_width(word, 18, True)
            write(image, right, 19, word, 18, STYLE.ink, bold=True)
            right -= 2 * pad
        if event is None:
            self._draw_legend(image, right)
        else:
            unit = event.unit
            figure = f"{_plain(event.value)} {unit}, threshold {event.threshold:g} {unit}" if unit else ""
            width = text_width(figure, 15, True)
            write(image, right - width, 20, figure, 15, STYLE.ink, bold=True)
            rows = wrap(event.sentence, 13, right - width - 3 * pad, 2)
            y = (STYLE.footer_px + _BAR_PX - len(rows) * line_height(13)) // 2
            for k, row in enumerate(rows):
                write(image, pad, y + k * line_height(13), row, 13, STYLE.ink)
        return image

    def _draw_legend(self, image: Image, right: int) -> None:
        """What the colours mean, as far as there is room."""
        x, y = _PAD_PX, (STYLE.footer_px + _BAR_PX - line_height(12)) // 2
        for name, text in self._legend:
            wide = _KEY_PX + 5 + text_width(text, 12)
            if x + wide > right - _PAD_PX:
                return
            top = y + (line_height(12) - _KEY_PX) // 2
            image[top : top + _KEY_PX, x : x + _KEY_PX] = getattr(STYLE, name)
            write(image, x + _KEY_PX + 5, y, text, 12, STYLE.faint)
            x += wide + 16


def _plain(value: float) -> str:
    """With one decimal, and no sign before what rounds to 0."""
    return f"{round(value, 1) + 0.0:.1f}"


def _digit(sign: str) -> Image:
    return tile(sign, 26, STYLE.ink, STYLE.panel, bold=True)


def draw_scale_bar(view: Image, scale: float) -> None:
    metres = next((m for m in (50, 20, 10, 5, 2) if m * scale <= view.shape[1] / 4), 1)
    length, x, y = round(metres * scale), _PAD_PX, view.shape[0] - 14
    view[y - 1 : y + 5, x - 2 : x + length + 2] = STYLE.marking
    view[y : y + 4, x : x + length] = STYLE.outline
    label(f"{metres} m", 12, STYLE.outline, STYLE.marking).lay(view, x - 1, y - 20)


def draw_attribution(view: Image) -> None:
    text = label(ATTRIBUTION, 11, STYLE.outline, STYLE.marking)
    text.lay(view, view.shape[1] - text.share.shape[1] - 8, view.shape[0] - 21)
