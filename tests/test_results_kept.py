"""The runs of `make results` whose tables are kept: whole, of one edition, and what the pages say."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import tsbench
from tsbench.run.edition import edition_now
from tsbench.run.log.read import StoredRun, read_run

ROOT = Path(tsbench.__file__).parent.parent
FOLDERS = sorted(path.parent for path in (ROOT / "results").glob("*/run.json"))
# What goes into the tables of all planners, and pages with the analyses of these that they ask for.
TABLES = ("styles", "networks", "plant2-ft", "second-seed", "floors", "entrants", "pdm")
PAGES = {"README.md": ("floor",), "docs/floor.md": ("floor",), "docs/results.md": ("main",)}
_BLOCK = "<!-- analysis {} .*?<!-- end -->"


@pytest.fixture(scope="module")
def runs() -> list[StoredRun]:
    """Read, which refuses tables that are not those that the run wrote."""
    return [read_run(folder) for folder in FOLDERS]


def test_each_is_whole_and_of_the_edition_in_force(runs: list[StoredRun]) -> None:
    assert set(TABLES) <= {run.path.name for run in runs}
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
def test_the_pages_say_what_the_tables_say(tmp_path: Path) -> None:
    make = (ROOT / "Makefile").read_text(encoding="utf-8")
    (said,) = re.findall(r"^RUNS := (.*)$", make, re.MULTILINE)
    assert [said.index(name) for name in TABLES] == sorted(said.index(name) for name in TABLES)
    kept = [str(ROOT / "results" / name) for name in TABLES]
    for name in sorted({name for names in PAGES.values() for name in names}):
        command("analyse", name, *kept, "--out", str(tmp_path / "made"))
    for page, names in PAGES.items():
        text = (ROOT / page).read_text(encoding="utf-8")
        blocks = "\n".join(
            found for name in names for found in re.findall(_BLOCK.format(name), text, re.DOTALL)
        )
        assert blocks
        (tmp_path / "page.md").write_text(blocks, encoding="utf-8")
        command("analyse", "pages", str(tmp_path / "page.md"), "--from", str(tmp_path / "made"))
        assert (tmp_path / "page.md").read_text(encoding="utf-8") == blocks, page


def command(*words: str) -> None:
    subprocess.run([sys.executable, "-m", "tsbench", *words], check=True, capture_output=True)
