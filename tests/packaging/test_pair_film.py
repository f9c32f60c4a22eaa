"""The film at the top of README.md: what it says of real drives, its size, and where it is shown."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from PIL import Image as PilImage
from run_builders import episode, make_run
from scripts import load_script

from tsbench.episode.runner import EpisodeRunner
from tsbench.episode.trace import trace_path, write_trace
from tsbench.planners.registry import resolve
from tsbench.report.drawing.canvas import STYLE
from tsbench.scenarios.data_set import DataSet

ROOT = Path(__file__).resolve().parents[2]
FILM = ROOT / "docs/images/pair.gif"
PAIR = "yield-j-msk-9109661741-v0"
PLANNERS = ("idm", "blind")


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return load_script("pair_film")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Both halves of the pair as a planner drives them that ignores signs, and one that always obeys."""
    halves = [spec for spec in DataSet().table("dev") if spec.pair_id == PAIR]
    records = [episode(name, 0, 0, 0, scenario_id=spec.scenario_id) for name in PLANNERS for spec in halves]
    folder = make_run(tmp_path_factory.mktemp("made") / "run", records)
    for planner in PLANNERS:
        runner = EpisodeRunner(resolve(planner))
        for spec in halves:
            write_trace(trace_path(folder, planner, spec.scenario_id), runner.run(spec))
        runner.close()
    return folder


def test_a_film_of_a_run_ends_with_the_verdict_of_each_episode(script: ModuleType, run: Path, tmp_path: Path) -> None:
    first, again = tmp_path / "first.gif", tmp_path / "again.gif"
    for path in (first, again):
        script.main(str(run), PAIR, str(path), *PLANNERS)
    assert first.read_bytes() == again.read_bytes()
    with PilImage.open(first) as film:
        start = np.asarray(film.convert("RGB"))
        film.seek(film.n_frames - 1)
        end = np.asarray(film.convert("RGB"))

    def badges(page: np.ndarray) -> list[str]:
        """The colour of the ground of each verdict, row by row; a GIF's palette may be off by a little."""
        tops = [script._HEAD_PX + row * script._ROW_PX + script._TITLE_PX for row in range(len(PLANNERS))]
        pixels = [page[top + 2, script._left(column) + 2].astype(int) for top in tops for column in (0, 1)]
        names = ("violation", "destination", "plate_line")
        near = [[name for name in names if abs(pixel - getattr(STYLE, name)).max() < 6] for pixel in pixels]
        return ["".join(found) for found in near]

    assert badges(start) == [""] * 4
    assert badges(end) == ["violation", "destination", "destination", "plate_line"]


def test_the_film_is_small_and_the_first_picture_of_both_first_pages() -> None:
    assert FILM.stat().st_size < 2_000_000
    for page in (ROOT / "README.md", ROOT / "docs/index.md"):
        picture = page.read_text(encoding="utf-8").partition("](")[2].partition(")")[0]
        assert (page.parent / picture).resolve() == FILM
    with PilImage.open(FILM) as film:
        assert film.n_frames > 50
        assert film.info["loop"] == 0
