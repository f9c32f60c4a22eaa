"""What all charts share: colours, one look whatever the user's matplotlib is set to, the same bytes each time."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

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
        for path in paths:
            kind = path.suffix[1:]
            with io_errors_as_input_errors(path), replacing(path) as part:
                figure.savefig(part, dpi=_DPI, format=kind, metadata=_METADATA[kind])
