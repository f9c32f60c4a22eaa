"""The runs of `make results` whose tables are kept: whole, of one edition, and what the pages say."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import tsbench
from tsbench.run.edition import edition_now
from tsbench.run.log.read import StoredRun, read_run

ROOT = Path(tsbench.__file__).parent.parent
FOLDERS = sorted(path.parent for path in (ROOT / "results").glob("*/run.json"))
# What goes into the table of floors.
FLOOR = ("styles", "plant2-ft", "floors")


@pytest.fixture(scope="module")
def runs() -> list[StoredRun]:
    """Read, which refuses tables that are not those that the run wrote."""
    return [read_run(folder) for folder in FOLDERS]


def test_each_is_whole_and_of_the_edition_in_force(runs: list[StoredRun]) -> None:
    assert set(FLOOR) <= {run.path.name for run in runs}
    for run in runs:
        assert run.manifest["status"] == "complete"
        assert not any(run.holes(name) for name in run.asked)
        assert run.manifest["edition"] == edition_now()
        assert run.manifest["effective"]["variants"] == "one-per-map"
    assert len({run.contract for run in runs}) == 1


def test_none_tells_of_the_folders_of_who_drove_it() -> None:
    for folder in FOLDERS:
        text = (folder / "run.json").read_text(encoding="utf-8")
        assert not re.search(r'"/(home|root|work|tmp|Users)/', text), folder


@pytest.mark.slow
def test_the_page_of_floors_says_what_the_tables_say(tmp_path: Path) -> None:
    page = Path(shutil.copy(ROOT / "docs" / "floor.md", tmp_path))
    kept = [str(ROOT / "results" / name) for name in FLOOR]
    for words in (
        ["floor", *kept, "--out", str(tmp_path / "made")],
        ["pages", str(page), "--from", str(tmp_path / "made")],
    ):
        subprocess.run([sys.executable, "-m", "tsbench", "analyse", *words], check=True, capture_output=True)
    assert page.read_text(encoding="utf-8") == (ROOT / "docs" / "floor.md").read_text(encoding="utf-8")
