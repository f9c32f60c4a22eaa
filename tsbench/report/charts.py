"""Charts: colours and one look whatever matplotlib's settings, as files or as SVG inside a page.

The same figures give the same bytes. SVG in a page takes the colours of the page, light or dark.
"""

from __future__ import annotations

import io
import re
import threading
import unicodedata
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

import matplotlib as mpl
from lxml import etree
from markupsafe import Markup
from matplotlib.figure import Figure
from matplotlib.font_manager import fontManager
from matplotlib.ft2font import FT2Font
from matplotlib.text import Text

from tsbench.core.files import io_errors_as_input_errors, replacing

# Okabe and Ito (2008): told apart with any colour vision, and in this order by lightness too.
GROUP_COLOURS = {"priority": "#0072b2", "speed": "#d55e00", "obstacles": "#cc79a7", "routing": "#009e73"}
INK, GREY, PALE = "#303030", "#808080", "#c4c4c4"
_DPI = 150
# Neither the date nor matplotlib's version: the same figures give the same bytes.
_METADATA: dict[str, dict[str, str | None]] = {
    "png": {"Software": "tsbench"},
    "svg": {"Creator": "tsbench", "Date": None},
}

# matplotlib's settings are those of the whole process.
_STYLE = threading.RLock()


@contextmanager
def house_style() -> Iterator[None]:
    """matplotlib's own defaults, and ids in SVG that do not change from call to call; one thread at a time draws."""
    with _STYLE, mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams["svg.hashsalt"] = "tsbench"
        yield


def save_chart(draw: Callable[[], Figure], *paths: Path) -> None:
    """Draw once and write each path in the format of its suffix (.png or .svg). Raises InputError."""
    with house_style():
        figure = draw()
        _choose_fonts(figure)
        for path in paths:
            kind = path.suffix[1:]
            with io_errors_as_input_errors(path), replacing(path) as part:
                figure.savefig(part, dpi=_DPI, format=kind, metadata=_METADATA[kind])


def _choose_fonts(figure: Figure) -> None:
    """Names may have letters that matplotlib's own font lacks."""
    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        # An axis writes its labels anew whenever it is drawn.
        labels = [label.get_text() for label in axis.get_ticklabels()]
        if (shown := [legible(label)[0] for label in labels]) != labels:
            axis.set_ticklabels(shown)
    for text in figure.findobj(Text):
        words, file = legible(text.get_text())
        text.set_text(words)
        if file:
            text.get_fontproperties().set_file(file)


@lru_cache(maxsize=4096)
def legible(text: str) -> tuple[str, str]:
    """What a picture shows of a text, and the font for it: a file, "" for DejaVu Sans, which comes with matplotlib.

    Letters that no installed font has together are written by their names in Unicode, as in `han-gug-eo`.
    """
    if text.isascii():
        return text, ""

    def lacking(path: str) -> list[str]:
        font = _letters(path)
        return [letter for letter in text if not letter.isspace() and not font.get_char_index(ord(letter))]

    missing = lacking(str(Path(mpl.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"))
    if not missing:
        return text, ""
    upright = [f for f in fontManager.ttflist if f.style == "normal" and not f.name.startswith("Last Resort")]
    for font in sorted(upright, key=lambda f: ("Sans" not in f.name, f.weight not in (400, "normal"), f.name, f.fname)):
        if not lacking(font.fname):
            return text, font.fname
    return re.sub(f"[{re.escape(''.join(missing))}]+", _in_latin, text), ""


_letters = lru_cache(maxsize=64)(FT2Font)


def _in_latin(found: re.Match[str]) -> str:
    names = [unicodedata.name(letter, f"{ord(letter):x}") for letter in found[0]]
    return "-".join(re.split("[ -]", name)[-1].lower() for name in names)


_SVG = "{http://www.w3.org/2000/svg}"
_LINK = "{http://www.w3.org/1999/xlink}href"
# What a figure's colour becomes; CSS variables of base.css.
_COLOURS = {
    **dict.fromkeys((INK, "#000000"), "currentColor"),
    **{GREY: "var(--faint)", PALE: "var(--line)", "#e4e4e4": "var(--grid)", "#ffffff": "var(--card)"},
    **{colour: f"var(--group-{group})" for group, colour in GROUP_COLOURS.items()},
}
_COLOUR = re.compile("|".join(_COLOURS))


def inline_svg(draw: Callable[[], Figure], name: str, label: str) -> Markup:
    """name: before its ids, so that those of several figures differ; label: what those hear who do not see it."""
    file = io.BytesIO()
    with house_style():
        mpl.rcParams["svg.fonttype"] = "none"
        # Its letters stay text, for the fonts of the reader's machine.
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", r"Glyph \d+ .* missing from font")
            draw().savefig(file, format="svg", transparent=True, metadata={"Creator": None, "Date": None})
    root = etree.fromstring(file.getvalue(), etree.XMLParser(resolve_entities=False, no_network=True))
    for element in root.iter():
        _adapt(element, name)
    etree.strip_elements(root, f"{_SVG}style", f"{_SVG}metadata")
    root.set("role", "img")
    root.set("aria-label", label)
    return Markup(etree.tostring(root, encoding="unicode", with_tail=False))


def _adapt(element: etree._Element, name: str) -> None:
    attributes = element.attrib
    if "id" in attributes:
        attributes["id"] = f"{name}-{attributes['id']!s}"
    if _LINK in attributes:
        attributes[_LINK] = str(attributes[_LINK]).replace("#", f"#{name}-")
    for key in ("clip-path", "style", "fill", "stroke"):
        if key in attributes:
            text = str(attributes[key]).replace("url(#", f"url(#{name}-")
            attributes[key] = _COLOUR.sub(lambda found: _COLOURS[found.group()], text)
