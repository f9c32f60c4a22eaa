"""The campaigns of `results/`: what they drive is what is kept and what pages ask for; all steps on four pairs."""

from __future__ import annotations

import csv
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from command_line import in_process
from test_docs_commands import wrong

import tsbench
from tsbench.cli.run import options_of, read_campaign
from tsbench.core.paths import OWN_CITY
from tsbench.episode.perception_level import EXACT
from tsbench.run.edition import contract_hash, standing_contract
from tsbench.run.log.manifest import read_manifest
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.catalog import load_catalog

ROOT = Path(tsbench.__file__).parent.parent
FILE = ROOT / "results" / "campaign.yaml"
PAGES = ("docs/results.md", "docs/floor.md", "README.md")
_ASKED = re.compile(r"^<!-- analysis (\S+).*? \| planners ([^|>]+?)(?: \||(?: -->))", re.MULTILINE)


RUNS, ANALYSES = read_campaign(FILE)


def test_the_kept_runs_are_those_of_the_file() -> None:
    assert {one.name for one in RUNS} == {path.parent.name for path in FILE.parent.glob("*/run.json")}
    for one in RUNS:
        manifest = read_manifest(FILE.parent / one.name)
        kept = {"perception": EXACT, **manifest["asked"], "city": manifest["effective"].get("city", OWN_CITY)}
        given = options_of(one, {}, FILE)
        asked = {**given, "city": given["data"].name, "types": list(given["types"])}
        for drives in (asked, kept):
            drives["planners"] = [spec.rpartition(":")[2] for spec in drives["planners"]]
        where = {"workers", "executor", "out"}
        assert {key: asked[key] for key in asked.keys() & kept.keys() - where} == {
            key: kept[key] for key in kept.keys() - where
        }, one.name


def test_the_file_drives_every_planner_that_a_page_asks_for() -> None:
    driven = {one.name: {spec.rpartition(":")[2] for spec in one.given["planners"]} for one in RUNS}
    tables = {a.name: set().union(*(driven[run.name] for run in a.runs)) for a in ANALYSES}
    asked = [found for name in PAGES for found in _ASKED.findall((ROOT / name).read_text())]
    assert len(asked) >= 4
    for table, planners in asked:
        assert set(planners.split(", ")) <= tables[table]


@pytest.mark.skipif(shutil.which("make") is None, reason="no make on this machine")
@pytest.mark.parametrize("target", ["results", "pages", "floor", "holdout", "board"])
def test_a_target_is_commands_that_there_are(target: str) -> None:
    around = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MFLAGS", "MAKEOVERRIDES")}
    done = subprocess.run(
        ["make", "--dry-run", "--old-file=setup", target, "BIN=bin"],
        cwd=ROOT, env=around, capture_output=True, text=True, check=True,
    )  # fmt: skip
    found = re.findall(r"bin/tsbench (.*?)(?: \|\||;|$)", done.stdout.replace("\\\n", ""), re.M)
    assert found
    assert [wrong(f"tsbench {line}") for line in found] == [None] * len(found)
    for file in re.findall(r"tsbench campaign (\S+)", done.stdout):
        assert read_campaign(ROOT / file)[0]


def test_every_step_on_four_pairs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One type of each group, of two data sets."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "few.yaml").write_text(
        """
        defaults: {split: dev, variants: one-per-map, workers: 1, trace: none, limit: 8}
        runs:
          - {name: drivers, planner: [idm, idm-e]}
          - {name: town, planner: idm-e, city: north-bayreuth, split: test}
        analyses:
          - {analysis: main, runs: [drivers]}
          - {analysis: floor, name: other, runs: [town]}
        """
    )
    page = tmp_path / "page.md"
    page.write_text(
        "<!-- analysis main | columns planner, paired SCD all | bare | contract -->\n<!-- end -->\n"
        "<!-- analysis other | where over = all | columns planner, paired SCD % | bare -->\n<!-- end -->\n"
    )
    few = "stop,speed_limit,detour_right,no_entry"
    in_process("campaign", capsys)("few.yaml", "--types", few, "--out", "runs")
    in_process("analyse", capsys)("pages", "page.md", "--from", "runs/analyses")
    rows = [line.strip("| ").split(" | ") for line in page.read_text().splitlines() if line.startswith("| ")]
    with Path("runs/analyses/campaign.csv").open(encoding="utf-8") as file:
        found = {(row["run"], row["planner"]): float(row["paired_scd"]) for row in csv.DictReader(file)}
    assert list(found) == [("drivers", "idm"), ("drivers", "idm-e"), ("town", "idm-e")]
    assert found["drivers", "idm"] < found["drivers", "idm-e"]
    assert rows[1:3] + rows[4:] == [[name, f"{figure:.1f}"] for (_, name), figure in found.items()]
    contract = standing_contract(contract_hash(DataSet().table("dev"), load_catalog()))
    assert f"Contract `{contract}`." in page.read_text()
