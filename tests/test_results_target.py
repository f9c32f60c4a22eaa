"""`make results`: all its steps on four pairs, into copies of the pages; its defaults against the pages themselves."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest

import tsbench
from tsbench.run.contract import contract_hash
from tsbench.run.edition import standing_contract
from tsbench.scenarios.table import read_table, table_path
from tsbench.signs.catalog import load_catalog

ROOT = Path(tsbench.__file__).parent.parent
PAGES = ("docs/results.md", "docs/floor.md", "README.md")
# One type of each group of types: the pages have a column for each group.
FEW = {
    "TYPES": "stop,speed_limit,detour_right,no_entry", "LIMIT": "8", "STYLES": "idm", "NETWORKS": "", "EXPERT": "",
    "BLIND": "blind", "BARE": "tsbench.planners.plant2.ablations:WithoutHalts", "READERS": "reader", "MIRRORED": "idm",
    "LEVELS": "good", "SECOND": "", "ENTRANTS": "", "PROPOSALS": "", "LAWFUL": "", "REACTIVE": "idm",
    "COMPARED": "",
}  # fmt: skip
DRIVEN = ("idm", "plant2-ft", "Lawless", "blind")
_ASKED = re.compile(r"^<!-- analysis (\S+).*? \| planners ([^|>]+?)(?: \||(?: -->))", re.MULTILINE)

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="no make on this machine")


def make_results(*options: str, **variables: str) -> str:
    """`make results` with these variables, in the environment of this Python: nothing is installed. What it printed."""
    bin_folder = Path(sys.executable).parent
    # A `make` around this one would pass its own options on.
    around = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MFLAGS", "MAKEOVERRIDES")}
    # The copy of tsbench under test, whatever the environment has installed.
    around["PYTHONPATH"] = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    done = subprocess.run(
        ["make", "--old-file=setup", *options, "results", f"VENV={bin_folder.parent}", f"BIN={bin_folder}",
         *(f"{name}={value}" for name, value in variables.items())],
        cwd=ROOT, env=around, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    return done.stdout


def with_driven_planners(text: str) -> str:
    """A page that asks for those of its planners that a trial drives; for idm where it drives none of them."""

    def fewer(found: re.Match[str]) -> str:
        kept = [name for name in DRIVEN if name in re.split(", ", found[2])]
        return found[0].replace(f"planners {found[2]}", f"planners {', '.join(kept)}")

    # The mirrored data set has one planner in a trial.
    text = re.sub(r"(<!-- analysis mirrored-moscow .*)\| planners plant2-ft ", r"\1| planners idm ", text)
    return _ASKED.sub(fewer, text)


def table_after(mark: str, page: str) -> list[list[str]]:
    """The cells of the table that stands behind a comment."""
    block = page.split(mark, 1)[1].split("<!-- end -->", 1)[0]
    lines = [line for line in block.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def share_of_pairs(folder: Path) -> str:
    """Pairs of which both halves are passed, %, from the records: four types with one pair each."""
    halves = pq.read_table(folder / "episodes.parquet", columns=["scenario_id", "scd"]).to_pylist()
    passed: dict[str, bool] = {}
    for half in halves:
        name = half["scenario_id"].removesuffix("-c")
        passed[name] = passed.get(name, True) and bool(half["scd"])
    assert (len(halves), len(passed)) == (8, 4)
    return f"{100.0 * sum(passed.values()) / 4:.1f}"


@pytest.mark.slow
def test_every_step_works_on_four_pairs(tmp_path: Path) -> None:
    before = {name: (ROOT / name).read_bytes() for name in PAGES}
    (tmp_path / "docs" / "images").mkdir(parents=True)
    for name in PAGES:
        (tmp_path / name).write_text(with_driven_planners((ROOT / name).read_text()))
    runs = tmp_path / "runs"
    copies = " ".join(str(tmp_path / name) for name in PAGES)
    asked = {**FEW, "RESULTS": str(runs), "PAGES": copies, "WORKERS": "1"}
    assert " -m pip " not in make_results("--dry-run", **asked)
    make_results(**asked)
    assert before == {name: (ROOT / name).read_bytes() for name in PAGES}

    results, floor, readme = ((tmp_path / name).read_text() for name in PAGES)
    head, *rows = table_after("<!-- analysis main | where figure = strict", results)
    assert head[:2] == ["planner", "paired SCD all"]
    found = {row[0]: row[1] for row in rows}
    assert set(found) == {"idm", "plant2-ft", "Lawless", "blind (floor)"}
    assert found["idm"] == share_of_pairs(runs / "styles")
    assert found["plant2-ft"] == share_of_pairs(runs / "plant2-ft")
    contract = standing_contract(contract_hash(read_table(table_path("test")), load_catalog()))
    for page in (results, floor, readme):
        assert f"Contract `{contract}`." in page
    head, *rows = table_after("<!-- analysis floor | where over = all", readme)
    assert head[:2] == ["planner", "paired SCD %"]
    assert [row[0] for row in rows] == ["idm", "plant2-ft", "blind (floor)"]
    assert rows[1][1] == found["plant2-ft"]
    for picture in re.findall(r"<!-- figure \S+ -->\n!\[[^\]]*\]\(([^)]+)\)", results):
        assert (tmp_path / "docs" / picture).stat().st_size > 1000
    assert (runs / "report.html").stat().st_size > 100_000


def test_its_defaults_drive_every_planner_that_a_page_asks_for() -> None:
    steps = make_results("--dry-run", RESULTS="runs/x")
    driven = {
        out: {name.rpartition(":")[2] for name in re.findall(r"--planner (\S+)", step)}
        for step, out in re.findall(r"(tsbench run .*) --out runs/x/([^\s$]+)", steps)
    }
    pooled = re.search(r"analyse \$name (.*) --out", steps)
    assert pooled is not None
    of_all = {planner for run in pooled[1].split() for planner in driven[run.removeprefix("runs/x/")]}
    tables = {"floor": of_all, "main": of_all, **driven}
    asked = [found for name in PAGES for found in _ASKED.findall((ROOT / name).read_text())]
    assert len(asked) >= 4
    for table, planners in asked:
        assert set(planners.split(", ")) <= tables[table]
