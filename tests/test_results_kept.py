"""The runs of `make results` whose tables are kept: whole, of one edition, and what the pages say."""

from __future__ import annotations

import csv
import re
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import tsbench
from tsbench.cli.run import read_campaign
from tsbench.core.paths import OWN_CITY
from tsbench.report.analyses.failures import CAUSES
from tsbench.run.edition import (
    built_editions,
    contract_now,
    edition_now,
    edition_of,
    editions,
    in_force,
    mirrored_contract,
    standing_contract,
)
from tsbench.run.log.read import StoredRun, read_run
from tsbench.scenarios.data_set import DataSet

ROOT = Path(tsbench.__file__).parent.parent
FOLDERS = sorted(path.parent for path in (ROOT / "results").glob("*/run.json"))
_, ANALYSES = read_campaign(ROOT / "results" / "campaign.yaml")
# By the name of a block on a page. Left out are one that needs traces, and one with a picture alone.
MADE = {one.name: one for one in ANALYSES if one.name not in ("perception", "intervals")}
PAGES = ("README.md", "docs/floor.md", "docs/results.md")
_BLOCK = r"<!-- analysis (\S+) .*?<!-- end -->"


@pytest.fixture(scope="module")
def runs() -> list[StoredRun]:
    """Read, which refuses tables that are not those that the run wrote."""
    return [read_run(folder) for folder in FOLDERS]


@cache
def contract_of_test(city: str) -> str:
    """That of the edition's results."""
    town = DataSet.named(city)
    (edition,) = [e for e in (*editions(), *built_editions()) if e.name == edition_now(town)] or [in_force(town)]
    kept = edition.kept("test")
    return mirrored_contract(kept) if town.mirrored else kept


def test_each_is_whole_and_of_the_edition_in_force(runs: list[StoredRun]) -> None:
    for run in runs:
        assert run.manifest["status"] == "complete"
        assert not any(run.holes(name) for name in run.asked)
        split, variants = (run.manifest["effective"][name] for name in ("split", "variants"))
        assert (split, variants) in {("test", "one-per-map"), ("two-signs", "all"), ("dev", "all")}
        town = DataSet.named(run.manifest["effective"].get("city", OWN_CITY))
        named = edition_now(town) if split == "test" else town.editions()[split]
        assert run.manifest["edition"] == edition_of(run.contract, "", town) == named
        # Those of dev are what a planner that is run today is compared with.
        contract = contract_of_test(town.name) if split == "test" else contract_now(town, split)
        assert standing_contract(run.contract) == contract


def test_none_tells_of_the_folders_of_who_drove_it() -> None:
    for folder in FOLDERS:
        text = (folder / "run.json").read_text(encoding="utf-8")
        assert not re.search(r'"/(home|root|work|tmp|Users)/', text), folder


@pytest.mark.slow
def test_the_pages_say_what_the_tables_say(tmp_path: Path) -> None:
    found = {page: (ROOT / page).read_text(encoding="utf-8") for page in PAGES}
    blocks = {
        page: [block[0] for block in re.finditer(_BLOCK, text, re.DOTALL) if block[1] in MADE]
        for page, text in found.items()
    }
    assert all(blocks.values())
    (tmp_path / "made").mkdir()
    for name, analysis in MADE.items():
        kept = [str(ROOT / "results" / run.name) for run in analysis.runs]
        command("analyse", analysis.kind, *kept, "--out", str(tmp_path / name))
        shutil.copy(tmp_path / name / f"{analysis.kind}.md", tmp_path / "made" / f"{name}.md")
    for page, said_there in blocks.items():
        text = "\n".join(said_there)
        assert filled(text, tmp_path / "made", tmp_path / "page.md") == text, page
    for table in (tmp_path / "tables").iterdir():
        assert table.read_bytes() == (ROOT / "docs" / "tables" / table.name).read_bytes(), table.name


@pytest.mark.slow
def test_imperfect_eyes_are_told_as_they_were_found(tmp_path: Path) -> None:
    """Causes of failures come from traces, which are not kept; all else is made again."""
    (analysis,) = (one for one in ANALYSES if one.name == "perception")
    kept = [str(ROOT / "results" / run.name) for run in analysis.runs]
    command("analyse", "perception", *kept, "--out", str(tmp_path))
    made, told = (
        list(csv.DictReader((folder / "perception.csv").open(encoding="utf-8")))
        for folder in (tmp_path, ROOT / "results" / "analyses")
    )
    assert [row | dict.fromkeys(CAUSES, "") for row in told] == made
    for row in told:
        causes = [int(row[cause]) for cause in CAUSES if row[cause]]
        assert bool(causes) is (row["level"] != "exact")
        assert sum(causes) <= int(row["failed"])
    page = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    (block,) = (found[0] for found in re.finditer(_BLOCK, page, re.DOTALL) if found[1] == "perception")
    assert filled(block, ROOT / "results" / "analyses", tmp_path / "page.md") == block
    image = ROOT / "docs" / "images" / "results-perception.png"
    assert image.read_bytes() == (ROOT / "results" / "analyses" / "perception.png").read_bytes()


def filled(text: str, analyses: Path, page: Path) -> str:
    """A page with this text, once its tables are made of the analyses in a folder."""
    page.write_text(text, encoding="utf-8")
    command("analyse", "pages", str(page), "--from", str(analyses))
    return page.read_text(encoding="utf-8")


def command(*words: str) -> None:
    subprocess.run([sys.executable, "-m", "tsbench", *words], check=True, capture_output=True)
