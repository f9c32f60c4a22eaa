"""The contract covers all that makes a record: every file, the data of the rows, versions; and nothing else."""

from __future__ import annotations

import ast
import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from run_helpers import spec, specs

import tsbench
from tsbench.core import provenance
from tsbench.core.paths import data_root
from tsbench.core.provenance import closure
from tsbench.run import contract
from tsbench.run.contract import ROOTS, code_files, contract_hash
from tsbench.signs.catalog import Catalog, load_catalog

PLACE = Path(tsbench.__file__).parent.parent
# What a worker may import beside the contract and the planner that it drives, and why no score depends on it.
NO_MATTER = {
    "tsbench/planners/builtin.py": "the list of tsbench's planners: run.json has what it says of the one that drives",
    "tsbench/planners/weights.py": "reads how many parameters the listed networks have",
    "tsbench/core/fetch.py": "fetches weights, whose hash is the planner's",
    "tsbench/core/data_manifest.py": "reads which weights could be fetched",
}
DRIVEN = """
import io, json, sys
from tsbench.episode.perception_level import EXACTLY
from tsbench.run.execution.messages import TO_RUN, Finished, Probe, Setup, Start, Task, decode, encode
from tsbench.run.execution.worker_main import Worker
from tsbench.run.planner_info import PlannerInfo
from tsbench.scenarios.table import read_table, table_path

class Line:
    def __init__(self):
        who = PlannerInfo("idm", "idm", False, False, (), None, None)
        row = min(read_table(table_path("test")), key=lambda row: row.horizon)
        self.told = [Start(tuple(sys.path), ()), Setup((who,), EXACTLY, "cpu", "all", sys.argv[1], "test", ""),
                     Probe("idm"), Task(1, 0, row)]
        self.before = {"tsbench.scenarios.table", "tsbench.core.parquet"}  # of this script
    def makefile(self, mode):
        return io.BytesIO(b"".join(map(encode, self.told)))
    def sendall(self, answer):
        self.answer = decode(answer, TO_RUN)

class Pulse:
    task = 0
    def begin(self, task): pass
    def beat(self, phase): pass

line = Line()
worker = Worker(line, Pulse())
worker.serve()
worker.close()
row = line.answer.record.row
assert row["scd"] in (True, False) and row["error"] is None, line.answer
files = [m.__file__ for n, m in sys.modules.items() if n.partition(".")[0] == "tsbench" and n not in line.before]
print(json.dumps([file for file in files if file]))
"""


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of tsbench's sources, to be edited."""
    place = tmp_path_factory.mktemp("copy")
    shutil.copytree(PLACE / "tsbench", place / "tsbench", ignore=lambda _, names: {
        name for name in names if Path(name).suffix not in ("", ".py", ".yaml") or name in ("__pycache__", "static")
    })  # fmt: skip
    return place


def test_every_file_a_worker_imports_is_accounted_for(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", DRIVEN, str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    imported = {Path(file).relative_to(PLACE).as_posix() for file in json.loads(done.stdout)}
    ours = set(code_files())
    planner = set(closure(["tsbench.planners.idm"], ours))
    assert {"tsbench/run/log/score.py", "tsbench/planners/idm.py", "tsbench/signs/annotations.py"} <= imported
    assert imported - ours - planner == set(NO_MATTER)


def test_a_worker_finds_the_names_that_its_run_has_found(monkeypatch: pytest.MonkeyPatch) -> None:
    assert contract.file_names() == set(code_files())
    monkeypatch.setattr(contract, "code_files", None)
    contract.use_file_names(["tsbench/a.py"])
    try:
        assert contract.file_names() == {"tsbench/a.py"}
    finally:
        contract.use_file_names([])
    monkeypatch.undo()
    assert contract.file_names() == set(code_files())


def test_changing_any_file_of_the_contract_changes_it_and_a_planner_does_not(copy: Path) -> None:
    before = code_files(copy)
    assert before == code_files()

    def changed(names: list[str]) -> set[str]:
        """Which files are others after something was added to these."""
        texts = {}
        for name in names:
            module, _, data = name.partition(": ")
            path = copy / module if not data else (copy / module).with_name(data)
            texts[path] = path.read_text(encoding="utf-8")
            path.write_text(f"{texts[path]}\n_CHANGED = 1\n", encoding="utf-8")
        after = code_files(copy)
        for path, text in texts.items():
            path.write_text(text, encoding="utf-8")
        return {n for n in before if before[n] != after[n]}

    # Half of them at a time: each changes itself, and none another.
    names = sorted(before)
    for some in (names[::2], names[1::2]):
        assert changed(some) == set(some)
    of_data = next(name for name in names if ": " in name)
    for name in (names[0], of_data):
        assert changed([name]) == {name}
    others = {p.relative_to(copy).as_posix() for p in (copy / "tsbench").rglob("*.py")} - set(before)
    assert {
        "tsbench/planners/idm.py",
        "tsbench/planners/builtin.py",
        "tsbench/metrics/aggregate.py",
        "tsbench/run/execution/ray.py",
    } <= others
    for name in sorted(others):
        (copy / name).write_text("_CHANGED = 1\n", encoding="utf-8")
    assert code_files(copy) == before


def test_a_line_that_makes_every_episode_a_success_is_another_contract(copy: Path) -> None:
    """What stands in a record is decided by files that earlier lists forgot."""
    path = copy / "tsbench" / "run" / "log" / "score.py"
    text = path.read_text(encoding="utf-8")
    cheat = text.replace("    return row, events\n", '    row["scd"] = True\n    return row, events\n')
    assert cheat != text
    before = code_files(copy)
    path.write_text(cheat, encoding="utf-8")
    assert code_files(copy) != before
    # Words about the code are no code.
    path.write_text(
        text.replace('"""From an', '"""# From an').replace("\n\n\n", "\n\n\n# a remark\n"), encoding="utf-8"
    )
    assert path.read_text(encoding="utf-8") != text
    assert code_files(copy) == before
    path.write_text(text, encoding="utf-8")


def test_roots_are_there() -> None:
    assert all((PLACE / name).is_file() for name in ROOTS)


def test_nothing_in_the_contract_imports_what_only_a_run_would_show() -> None:
    """But for two places: what a worker is told to run is among the roots, and a planner has its own hash."""
    found, packages = set(), set()
    for name in (name for name in code_files() if name.endswith(".py")):
        for node in ast.walk(ast.parse((PLACE / name).read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_all"):
                assert isinstance(node.args[0], ast.Constant), (
                    f"{name}: only a package that is written out counts"
                )
                packages.add(node.args[0].value)
            if isinstance(node, ast.Attribute | ast.Name):
                word = node.attr if isinstance(node, ast.Attribute) else node.id
                if word in ("import_module", "__import__", "spec_from_file_location", "exec", "eval"):
                    found.add(name)
    # Names of tsbench itself: `tsbench.__getattr__` imports what a planner asks for, `extras.load` what few have,
    # `modules.import_all` whole packages, which are in the contract as a whole.
    assert packages == {"tsbench.rules"}
    assert {f"tsbench/rules/{path.name}" for path in (PLACE / "tsbench" / "rules").glob("*.py")} <= set(
        code_files()
    )
    assert found == {
        "tsbench/__init__.py",
        "tsbench/core/extras.py",
        "tsbench/core/modules.py",
        "tsbench/planners/loading.py",
        "tsbench/run/execution/worker_main.py",
    }


def changed(catalog: Catalog, code: str) -> Catalog:
    rule = replace(catalog.sign(code).rule, thresholds={"tolerance_kmh": 99.0})
    return replace(catalog, signs={**catalog.signs, code: replace(catalog.sign(code), rule=rule)})


def test_the_signs_of_the_rows_count_and_no_others() -> None:
    catalog = load_catalog()
    rows = [spec(1, 0, 0)]  # of 3.24, which 3.25 ends
    assert rows[0].sign_code == "3.24"
    hashes = {code: contract_hash(rows, changed(catalog, code)) for code in ("3.24", "3.25", "2.5")}
    assert hashes["2.5"] == contract_hash(rows, catalog)
    assert len(set(hashes.values())) == 3
    lonely = replace(catalog, signs={c: s for c, s in catalog.signs.items() if c in ("3.24", "3.25")})
    assert contract_hash(rows, lonely) == hashes["2.5"]


def test_a_country_is_nothing_to_a_score(tmp_path: Path) -> None:
    root = tmp_path / "sign_catalog"
    shutil.copytree(data_root() / "sign_catalog", root)
    (root / "countries" / "de.yaml").write_text("not: read\n")
    sign = root / "signs" / "3.24.yaml"
    sign.write_text(sign.read_text().replace("Maximum speed limit", "Another name"))
    assert contract_hash(specs(), load_catalog(root)) == contract_hash(specs(), load_catalog())


def test_versions_count(monkeypatch: pytest.MonkeyPatch) -> None:
    rows, catalog = specs(), load_catalog()
    before = contract_hash(rows, catalog)
    for package in provenance.DECIDING:
        assert provenance.versions()[package]
        other = {**provenance.versions(), package: "0.0"}
        monkeypatch.setattr(contract, "versions", lambda other=other: other)
        assert contract_hash(rows, catalog) != before


def test_rows_count_and_their_order_does_not() -> None:
    rows, catalog = specs(), load_catalog()
    assert contract_hash(rows, catalog) == contract_hash(rows[::-1], catalog)
    other = [replace(rows[0], net_sha256="f" * 64), *rows[1:]]
    assert contract_hash(other, catalog) != contract_hash(rows, catalog)
