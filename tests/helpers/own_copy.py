"""Somebody's own copy of what a clone has, to add things to; and a scene of the test split under another plate."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
from patience import HANG_S

from tsbench.core.paths import data_root
from tsbench.core.xmlfile import sha256
from tsbench.scenarios.data_set import DataSet, write_table
from tsbench.scenarios.spec import SIGNED, ScenarioSpec
from tsbench.scenarios.store import SceneStore, store_path, write_store

ROOT = data_root()
COMMANDS = """
import sys
from tsbench.cli import main
for line in sys.argv[1:]:
    try:
        main(line.split())
    except SystemExit as ended:
        if ended.code:
            raise
"""


class Copy:
    """A folder with tsbench, the catalogue and the recipes, as a clone has them, and no scenes but those made here."""

    def __init__(self, root: Path) -> None:
        self.root = root

    def write(self, name: str, text: str) -> None:
        """A new file."""
        path = self.root / name
        assert not path.exists(), f"{name} is there already"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")

    def add_line(self, name: str, before: str, line: str) -> None:
        """One line put before the first place where `before` stands."""
        path = self.root / name
        text = path.read_text(encoding="utf-8")
        assert before in text, f"{name}: no {before!r}"
        path.write_text(text.replace(before, line + before, 1), encoding="utf-8")

    def like(self, name: str, *changes: tuple[str, str]) -> str:
        """The text of a file that is there with some words changed."""
        text = (self.root / name).read_text(encoding="utf-8")
        for old, new in changes:
            assert old in text, f"{name}: no {old!r}"
            text = text.replace(old, new)
        return text

    def python(self, *arguments: str) -> str:
        """What a fresh Python prints that sees this copy alone; its failure is a failure."""
        kept = {k: v for k, v in os.environ.items() if not k.startswith("TSBENCH")}
        path = os.pathsep.join((str(self.root), str(self.root / "tests" / "helpers")))
        done = subprocess.run(
            [sys.executable, *arguments], cwd=self.root, env={**kept, "PYTHONPATH": path, "COLUMNS": "160"},
            capture_output=True, text=True, timeout=HANG_S,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def tsbench(self, *lines: str) -> str:
        """What commands print that one fresh Python runs after another."""
        return self.python("-c", COMMANDS, *lines)

    def scene(self, scenario_type: str, **changes: object) -> ScenarioSpec:
        """The nominal scene of a type as the only row of the test split; changes: of its row, plate included."""
        row = next(r for r in DataSet().table("test") if (r.pair_type, r.half, r.variant) == (scenario_type, SIGNED, 0))
        store = SceneStore(DataSet())
        net, additional = (store.read(row, name).content for name in (row.net, row.additional))
        if "sign_code" in changes:
            old, new = (f'key="code" value="{code}"'.encode() for code in (row.sign_code, changes["sign_code"]))
            assert additional.count(old) == 1
            additional = additional.replace(old, new)
            if changes.get("sign_value", row.sign_value) is None:
                additional = re.sub(rb'<param key="value" [^>]*>', b"", additional)
        new_row = replace(row, **changes, additional_sha256=sha256(additional))  # type: ignore[arg-type]
        scenarios = self.root / "scenarios"
        path = store_path("test", new_row.scenario_type, scenarios)
        write_store([(row.map_id, {row.net: net, row.additional: additional})], path)
        write_table([new_row], scenarios / "test.parquet")
        return new_row


def make_copy(root: Path) -> Copy:
    """A copy with nothing added; maps of the pool and data of cities are linked."""
    for name in ("tsbench", "sign_catalog", "scenarios/recipes"):
        shutil.copytree(ROOT / name, root / name, ignore=shutil.ignore_patterns("*.safetensors"))
    (root / "cities").mkdir()
    for path in (ROOT / "cities").glob("*.yaml"):
        shutil.copy(path, root / "cities")
    for name in ("cities/data", "sumo_nets", "scenarios/nuplan_statistics.json"):
        (root / name).symlink_to(ROOT / name)
    return Copy(root)


def records(run: Path) -> dict[str, dict[str, Any]]:
    """The records of a run of one scene, by planner."""
    return {row["planner"]: row for row in pq.read_table(run / "episodes.parquet").to_pylist()}
