"""Figures that stand in the prose of pages, against the data and the tables that they are about."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from tsbench.core.fetch import data_sets

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
MEGABYTE = 1_000_000
SPLITS = ("train", "dev", "holdout", "test")


def cells(page: str, first: str) -> list[str]:
    """The other cells of the one row of a page's tables that begins with `first`."""
    (line,) = re.findall(rf"^\| {re.escape(first)} \| (.*) \|$", (ROOT / page).read_text(encoding="utf-8"), re.M)
    return [cell.strip() for cell in re.split(r"(?<!\\)\|", line)]


def halves(split: str) -> tuple[int, int]:
    """Signed rows of a split, and contrast rows."""
    column = pq.read_table(ROOT / f"scenarios/{split}.parquet", columns=["half"])["half"]
    count = {value["values"]: value["counts"] for value in pc.value_counts(column).to_pylist()}
    return count["signed"], count["contrast"]


@pytest.mark.parametrize("split", SPLITS)
def test_a_split_has_the_rows_that_the_page_says(split: str) -> None:
    signed, contrast = halves(split)
    assert cells("docs/scenes.md", f"`{split}`") == [f"{n:,}" for n in (signed, contrast, signed + contrast)]


def test_the_pool_has_the_rings_that_the_page_says() -> None:
    pool = pq.read_table(ROOT / "sumo_nets/pool.parquet", columns=["family"])["family"]
    rings = pc.sum(pc.equal(pool, "roundabout")).as_py()
    assert cells("docs/maps.md", "roundabout ring")[-1] == str(rings)


def test_the_files_of_a_clone_are_as_large_as_the_page_says() -> None:
    told = int(cells("docs/install.md", "files of a clone")[0].split()[0])
    tracked = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    files = [ROOT / name for name in tracked.stdout.split("\0") if name]
    size = sum(file.stat().st_size for file in files if file.is_file()) / MEGABYTE
    assert told == pytest.approx(size, rel=0.02)


@pytest.mark.parametrize("name", ["train", "holdout", "oracle"])
def test_data_sets_are_as_large_as_the_page_says(name: str) -> None:
    size = sum(file.size for file in data_sets()[name].files) / MEGABYTE
    assert cells("docs/install.md", f"`{name}`")[0] == f"{size:.1f} MB"


def test_paths_of_data_on_the_data_card_exist() -> None:
    named = re.findall(r"`([\w/]+\.(?:parquet|json|yaml|md))`", (DOCS / "data-card.md").read_text(encoding="utf-8"))
    assert named
    there = {path.name: path for top in ("scenarios", "sumo_nets") for path in (ROOT / top).glob("*.*")}
    assert [name for name in named if not (ROOT / name).is_file() and name not in there] == []


@pytest.mark.slow
def test_the_page_of_figures_is_that_of_the_data(tmp_path: Path) -> None:
    page = tmp_path / "dataset.md"
    done = subprocess.run(
        [sys.executable, "packaging/dataset_page.py", str(page)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    for made in (page, *(tmp_path / "tables").iterdir()):
        committed = DOCS / made.relative_to(tmp_path)
        assert made.read_bytes() == committed.read_bytes(), "packaging/dataset_page.py writes it"
    assert len(list((tmp_path / "tables").iterdir())) == 4
