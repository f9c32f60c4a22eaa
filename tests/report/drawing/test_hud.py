"""What is written around a picture: whole on small pages, with figures that differ where the values do."""

from __future__ import annotations

import math
from pathlib import Path

import episode_builders as made
import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.font_manager import fontManager

from tsbench.episode.trace import trace_of
from tsbench.report.charts import inline_svg, legible, save_chart
from tsbench.report.drawing.birds_eye import Strip
from tsbench.report.drawing.canvas import STYLE, PageSize
from tsbench.report.drawing.hud import FrameInfo, Hud, figures
from tsbench.report.drawing.paint import fitted, text_width, wrap, write
from tsbench.report.time_to_collision import how_near
from tsbench.report.wording import readable
from tsbench.signs.catalog import load_catalog
from tsbench.signs.countries import Artwork

SMALL = PageSize(480, 420)


@pytest.mark.parametrize(
    ("value", "threshold", "told"),
    [
        (54.1, 41.0, "54.1 km/h, threshold 41 km/h"),
        (3.98, 4.0, "3.98 km/h, threshold 4 km/h"),
        (3.9996, 4.0, "4.0 km/h, threshold 4 km/h"),
        (3.2, 4.04412, "3.2 km/h, threshold 4.04 km/h"),
        (-0.04, 1.0, "0.0 km/h, threshold 1 km/h"),
    ],
)
def test_figures_tell_apart_what_differs(value: float, threshold: float, told: str) -> None:
    assert figures(made.violation(value=value, threshold=threshold, unit="km/h")) == told


def test_units_are_printed_as_one_writes_them() -> None:
    assert figures(made.violation(value=3.0, threshold=2.5, unit="m/s2")) == "3.0 m/s², threshold 2.5 m/s²"
    assert figures(made.violation(value=90.0, threshold=35.0, unit="deg")) == "90.0°, threshold 35°"
    assert figures(made.violation(unit="")) == ""


def test_a_sentence_is_printed_with_the_same_units() -> None:
    assert readable("brake with 4.5 m/s2 (at most 2.5 m/s2).") == "brake with 4.5 m/s² (at most 2.5 m/s²)."
    assert readable("a turn of -0 deg, not -90 deg or +0 deg") == "a turn of 0°, not -90° or 0°"


@pytest.fixture
def own_fonts(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine that has the fonts of matplotlib alone."""
    own = [font for font in fontManager.ttflist if font.fname.startswith(mpl.get_data_path())]
    monkeypatch.setattr(fontManager, "ttflist", own)
    monkeypatch.setattr("tsbench.report.drawing.paint.legible", legible.__wrapped__)
    monkeypatch.setattr("tsbench.report.charts.legible", legible.__wrapped__)


@pytest.mark.usefixtures("own_fonts")
@pytest.mark.parametrize(
    ("name", "shown", "font"),
    [
        ("plant2-ft", "plant2-ft", ""),
        ("Правила: 1 m/s²", "Правила: 1 m/s²", ""),
        ("مخطط", "مخطط", ""),
        ("x规划器.py:한국어", "x89c4-5212-5668.py:han-gug-eo", ""),
        ("かな", "ka-na", ""),
        ("a⌕ b", "a⌕ b", "DejaVuSansMono.ttf"),
    ],
)
def test_a_picture_has_no_letter_that_its_font_lacks(name: str, shown: str, font: str) -> None:
    words, file = legible.__wrapped__(name)
    assert (words, Path(file).name) == (shown, font)


@pytest.mark.usefixtures("own_fonts")
def test_two_names_of_letters_without_a_font_differ() -> None:
    first, second = (np.zeros((40, 400, 3), dtype=np.uint8) for _ in range(2))
    write(first, 2, 2, "规划器", 15, STYLE.ink)
    write(second, 2, 2, "路径器", 15, STYLE.ink)
    assert (first != second).any()


def test_words_stand_from_left_to_right_after_an_arabic_name() -> None:
    whole, name = (np.zeros((40, 400, 3), dtype=np.uint8) for _ in range(2))
    write(whole, 2, 2, "مخطط: stop", 15, STYLE.ink)
    write(name, 2, 2, "مخطط", 15, STYLE.ink)
    width = text_width("مخطط", 15)
    assert (whole[:, :width] == name[:, :width]).all()


@pytest.mark.usefixtures("own_fonts")
@pytest.mark.filterwarnings("error")
def test_a_chart_has_letters_of_its_font_and_a_page_those_of_the_name(tmp_path: Path) -> None:
    def draw() -> Figure:
        figure = Figure()
        axes = figure.subplots()
        axes.set_xticks(range(2), ["规划器", "idm"])
        axes.set_title("规划器")
        return figure

    save_chart(draw, tmp_path / "chart.svg", tmp_path / "chart.png")
    drawn = (tmp_path / "chart.svg").read_text()
    assert drawn.count("<!-- 89c4-5212-5668 -->") == 2
    page = inline_svg(draw, "chart", "a chart")
    assert page.count(">规划器<") == 2


def test_titles_and_ids_of_all_types_fit_on_a_small_page() -> None:
    room = SMALL.width - SMALL.header_px - 24
    for kind in load_catalog().types:
        title, _ = fitted(f"idm-e again: {kind.id}, contrast half", (15, 14, 13, 12, 11), room, bold=True)
        line, _ = fitted(f"{kind.id}-c-msk-0ba5585f95-v0-c · sign 5.15.1 (40)", (11, 10), room)
        assert "…" not in title + line


def test_a_long_sentence_and_the_figures_stand_on_a_small_page() -> None:
    sentence = (
        "At 17.3 s the ego drove 3.8 m/s for nobody over a passage where sign 2.1 does not make it wait, "
        "and then it went on to the next one as slowly (at least 4.0 m/s)."
    )
    assert "…" not in wrap(sentence, 12, SMALL.width - 24, 3)[-1]
    hud = Hud(SMALL, "title", "below", (made.sign(),), Artwork(load_catalog()), [0.5])
    page = np.zeros((SMALL.height, SMALL.width, 3), dtype=np.uint8)
    event = made.violation(sentence=sentence)
    hud.footer(page, FrameInfo(1.0, 5.0, 0.5, event, ""))
    below = page[-16:]
    assert (below == STYLE.ink).all(axis=2).any()  # the figures
    hud.footer(page, FrameInfo(1.0, 5.0, 0.5, None, ""))
    # All of the legend, in rows.
    for name in ("ego", "route", "trail", "plate_line", "destination"):
        assert (page[-SMALL.footer_px :] == getattr(STYLE, name)).all(axis=2).any(), name


def test_how_near_somebody_was() -> None:
    """A car comes towards the ego on its own lane: 40 m between centres, 36 m minus half the ego between bodies."""
    track = made.Track("car", made.straight(2, 140.0, -4.8, math.pi, 5.0))
    snapshot = made.snapshots([made.ego(100.0, speed=10.0)] * 2, [track])[0]
    told = how_near(snapshot, "car")
    gap = 40.0 - 2.0 - 4.9 / 2
    assert told.startswith("car ")
    away, ttc = float(told.split()[1]), float(told.split()[-2])
    assert away == pytest.approx(gap, abs=0.5)
    assert ttc == pytest.approx(away / 15.0, abs=0.06)
    aside = made.Track("car", made.straight(2, 140.0, 4.8, math.pi, 5.0))
    snapshot = made.snapshots([made.ego(100.0, speed=10.0)] * 2, [aside])[0]
    assert how_near(snapshot, "car").endswith("no collision course within 10 s")
    assert how_near(snapshot, "bus") == ""


def test_the_strip_shows_speed_violation_and_moment() -> None:
    egos = [made.ego(60.0 + k, speed=10.0 + 0.1 * k) for k in range(61)]
    trace = trace_of(made.result(made.facts(egos, target=made.verdict(made.violation(3.0)))))
    page = np.zeros((80, 400, 3), dtype=np.uint8)
    strip = Strip(trace, 400, 80)
    moments = []
    for time in (0.0, 3.0, 6.0):
        strip.lay(page, 0, time)
        moments.append(np.flatnonzero((page == STYLE.ink).all(axis=(0, 2)))[-1])
    # At the left edge, in the middle, at the right edge.
    assert np.abs(np.array(moments) - (0, 199, 398)).max() <= 1
    assert (page == STYLE.trail).all(axis=2).any()
    assert (page[:, 230] == page[0, 230]).all(axis=1).sum() > 40  # the time of the violation has another ground
    assert tuple(page[2, 230]) != STYLE.panel
