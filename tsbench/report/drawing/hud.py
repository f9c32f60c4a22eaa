"""Text around a picture: the planner, time and speed, the violation, scale, attribution."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from tsbench.report.drawing.canvas import ATTRIBUTION, STYLE, VIOLATION_SHADE, Image, PageSize
from tsbench.report.drawing.paint import fitted, label, line_height, paste, stamp, text_width, tile, wrap, write
from tsbench.report.wording import readable, unit_words
from tsbench.rules.monitor import Violation
from tsbench.signs.annotations import SignInstance
from tsbench.signs.countries import Artwork
from tsbench.signs.plates import plate_rgba

_BAR_PX = 5
_PAD_PX = 12
_CLOCK_PX = 190
_KEY_PX = 10
# Sizes of digits and of their units.
_CLOCK_FONT, _SMALL_CLOCK_FONT = (26, 14), (18, 12)
# Of a sentence: font sizes with the lines that a footer has room for.
_SENTENCE, _SMALL_SENTENCE = ((13, 2), (12, 3), (11, 3)), ((12, 3), (11, 3), (10, 4))
# Fields of `Style` and what they are in a picture, by how much one wants to know it.
LEGEND = {
    "ego": "ego",
    "route": "navigation's way",
    "trail": "driven",
    "convoy": "held for the ego",
    "pedestrian": "person",
    "bicycle": "bicycle",
    "bus": "bus",
    "car": "car",
    "plate_line": "target plate, its line",
    "destination": "destination",
    "plan": "planner's plan",
}
_ALWAYS = ("ego", "route", "trail", "plate_line", "destination")


@dataclass(frozen=True, slots=True)
class FrameInfo:
    """What the header and the footer say.

    event: the latest violation; near: distance of the road user that it names, "" = none; progress: 0-1 of the
    episode.
    """

    time: float
    speed: float
    progress: float
    event: Violation | None
    outcome: str
    near: str = ""


def header(
    size: PageSize, title: str, subtitle: str, signs: Sequence[SignInstance], artwork: Artwork, spare_px: int = 0
) -> Image:
    """A picture's head: plates, title and what is below it. spare_px: kept free at the right."""
    height, pad = size.header_px, _PAD_PX
    image = np.full((height, size.width, 3), STYLE.panel, dtype=np.uint8)
    side = height - 12
    x = pad
    for sign in signs:
        plate = plate_rgba(artwork, sign.code, sign.value, side, temporary=sign.temporary)
        paste(image, x, 6, plate[..., :3], plate[..., 3])
        x += side + pad
    room = size.width - x - pad - (0 if size.compact else spare_px + pad)
    sizes, top, below = ((15, 14, 13, 12, 11), 4, 24) if size.compact else ((18, 16, 14, 13), 10, 36)
    text, font = fitted(title, sizes, room, bold=True)
    write(image, x, top, text, font, STYLE.ink, bold=True)
    text, font = fitted(subtitle, (11, 10) if size.compact else (13, 12), room)
    write(image, x, below, text, font, STYLE.faint)
    return image


class Hud:
    """Header and footer of pages of one episode; the parts that never change are drawn once."""

    def __init__(
        self,
        size: PageSize,
        title: str,
        subtitle: str,
        signs: Sequence[SignInstance],
        artwork: Artwork,
        events: list[float],
        kinds: Collection[str] = (),
    ) -> None:
        """events: moments of violations as shares (0-1) of the episode. kinds: of bodies to be seen (`Body.kind`)."""
        self._size, self._width = size, size.width
        self._legend = [(name, text) for name, text in LEGEND.items() if name in _ALWAYS or name in kinds]
        self._events = events
        self._header = header(size, title, subtitle, signs, artwork, _CLOCK_PX)
        self._footers: dict[tuple[Violation | None, str, str], Image] = {}

    def header(self, page: Image, moment: FrameInfo) -> None:
        height = self._size.header_px
        page[:height] = self._header
        time, speed = f"{moment.time:.1f}", f"{3.6 * moment.speed:.0f}"
        if self._size.compact:
            x = height + _PAD_PX
            _number(page, x, 39, time, "s", _SMALL_CLOCK_FONT)
            _number(page, x + 90, 39, speed, "km/h", _SMALL_CLOCK_FONT)
            return
        right = self._width - _PAD_PX
        _number(page, right - _CLOCK_PX, 12, f"{time:>5}", "s", _CLOCK_FONT)
        width = text_width("km/h", 14) + 4 + sum(_digit(sign, _CLOCK_FONT[0]).shape[1] for sign in speed)
        _number(page, right - width, 12, speed, "km/h", _CLOCK_FONT)

    def footer(self, page: Image, moment: FrameInfo) -> None:
        """Write the footer into the bottom of a page: the time line, and the violation or the outcome."""
        key = (moment.event, moment.outcome, moment.near)
        if key not in self._footers:
            self._footers[key] = self._draw_footer(moment)
        top = page.shape[0] - self._size.footer_px
        page[top:] = self._footers[key]
        done = round(moment.progress * self._width)
        page[top : top + _BAR_PX, :done] = STYLE.faint
        for share in self._events:
            x = min(round(share * self._width), self._width - 4)
            page[top : top + _BAR_PX, max(x - 2, 0) : x + 3] = STYLE.violation

    def _draw_footer(self, moment: FrameInfo) -> Image:
        image = np.empty((self._size.footer_px, self._width, 3), dtype=np.uint8)
        event = moment.event
        image[:] = STYLE.panel if event is None else tuple(round(VIOLATION_SHADE * c) for c in STYLE.violation)
        image[:_BAR_PX] = (60, 66, 74)
        right, word = self._width - _PAD_PX, moment.outcome.replace("_", " ")
        if self._size.compact:
            self._draw_compact(image, moment, word)
            return image
        if word:
            right -= text_width(word, 18, True)
            write(image, right, 19, word, 18, STYLE.ink, bold=True)
            right -= 2 * _PAD_PX
        if event is None:
            self._draw_legend(image, right, image.shape[0])
            return image
        figure = figures(event)
        width = max(text_width(figure, 15, True), text_width(moment.near, 12))
        write(image, right - text_width(figure, 15, True), 12 if moment.near else 20, figure, 15, STYLE.ink, bold=True)
        write(image, right - text_width(moment.near, 12), 33, moment.near, 12, STYLE.ink)
        self._draw_sentence(image, event, right - width - 3 * _PAD_PX, image.shape[0], _SENTENCE)
        return image

    def _draw_compact(self, image: Image, moment: FrameInfo, word: str) -> None:
        """The sentence over the whole width, and below it a line with the figures and the outcome."""
        last = line_height(12) + 4 if moment.event is not None or word else 0
        y, right = image.shape[0] - last, self._width - _PAD_PX
        write(image, _PAD_PX, y, word, 12, STYLE.ink, bold=True)
        if moment.event is None:
            self._draw_legend(image, right, y or image.shape[0])
            return
        figure = figures(moment.event)
        write(image, right - text_width(figure, 12, True), y, figure, 12, STYLE.ink, bold=True)
        self._draw_sentence(image, moment.event, right - _PAD_PX, y, _SMALL_SENTENCE)

    @staticmethod
    def _draw_sentence(
        image: Image, event: Violation, width: int, height: int, choices: Sequence[tuple[int, int]]
    ) -> None:
        """In the largest letters in which all of it fits, else cut."""
        for font, lines in choices:
            rows = wrap(readable(event.sentence), font, width, lines)
            if "…" not in rows[-1]:
                break
        y = (height + _BAR_PX - len(rows) * line_height(font)) // 2
        for k, row in enumerate(rows):
            write(image, _PAD_PX, y + k * line_height(font), row, font, STYLE.ink)

    def _draw_legend(self, image: Image, right: int, height: int) -> None:
        """What the colours mean, in as many rows as there is room for."""
        rows: list[list[tuple[int, str, str]]] = [[]]
        x = _PAD_PX
        for name, text in self._legend:
            wide = _KEY_PX + 5 + text_width(text, 12)
            if x + wide > right:
                rows.append([])
                x = _PAD_PX
            rows[-1].append((x, name, text))
            x += wide + 16
        rows = rows[: (height - _BAR_PX) // line_height(12)]
        y = (height + _BAR_PX - len(rows) * line_height(12)) // 2
        for k, row in enumerate(rows):
            top = y + k * line_height(12)
            for left, name, text in row:
                key = top + (line_height(12) - _KEY_PX) // 2
                image[key : key + _KEY_PX, left : left + _KEY_PX] = getattr(STYLE, name)
                write(image, left + _KEY_PX + 5, top, text, 12, STYLE.faint)


def figures(event: Violation) -> str:
    """Measured value and threshold, "" without a unit; with as many digits as tell them apart, up to three."""
    if not event.unit:
        return ""
    unit, threshold = unit_words(event.unit), f"{event.threshold:.3g}"
    unit = unit if unit == "°" else f" {unit}"
    told = [_plain(event.value, digits) for digits in (1, 2, 3)]
    value = next((text for text in told if float(text) != float(threshold)), told[0])
    return f"{value}{unit}, threshold {threshold}{unit}"


def _plain(value: float, digits: int = 1) -> str:
    """With so many decimals, and no sign before what rounds to 0."""
    return f"{round(value, digits) + 0.0:.{digits}f}"


def _number(page: Image, x: int, y: int, text: str, unit: str, fonts: tuple[int, int]) -> None:
    large, small = fonts
    for sign in text:
        x = stamp(page, x, y, _digit(sign, large))
    # On the same base line.
    stamp(page, x + 4, y + round(0.93 * (large - small)), tile(unit, small, STYLE.faint, STYLE.panel))


def _digit(sign: str, font: int) -> Image:
    return tile(sign, font, STYLE.ink, STYLE.panel, bold=True)


def draw_scale_bar(view: Image, scale: float) -> None:
    metres = next((m for m in (50, 20, 10, 5, 2) if m * scale <= view.shape[1] / 4), 1)
    length, x, y = round(metres * scale), _PAD_PX, view.shape[0] - 14
    view[y - 1 : y + 5, x - 2 : x + length + 2] = STYLE.marking
    view[y : y + 4, x : x + length] = STYLE.outline
    _written(view, x - 1, y - 20, f"{metres} m", 12)


def draw_attribution(view: Image) -> None:
    width = text_width(ATTRIBUTION, 11) + 2
    _written(view, view.shape[1] - width - 8, view.shape[0] - 21, ATTRIBUTION, 11)


def _written(view: Image, x: int, y: int, text: str, size: int) -> None:
    """On the ground of the picture, made lighter: legible on asphalt too."""
    words = label(text, size, STYLE.outline, STYLE.marking)
    height, width = words.share.shape[:2]
    ground = view[y : y + height, x - 2 : x + width + 2]
    cv2.addWeighted(ground, 0.3, np.full_like(ground, 255), 0.7, 0.0, dst=ground)
    words.lay(view, x, y)
