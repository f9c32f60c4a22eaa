"""The notebook of the documentation, cell by cell in one process, as a reader runs it."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOK = ROOT / "docs/guides/first_run.ipynb"
# The last value of a cell is shown: as HTML where it has a way to.
SHOW = """
def _show(value):
    print("CELL", type(value).__name__, len(value._repr_html_()) if hasattr(value, "_repr_html_") else repr(value))
"""


def script(notebook: str) -> str:
    """The code cells in their order as one script; `%%writefile NAME` writes what follows."""
    parts = [SHOW]
    for cell in json.loads(notebook)["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] != "code":
            continue
        first, _, rest = source.partition("\n")
        if first.startswith("%%writefile "):
            parts.append(f"open({first.split()[1]!r}, 'w').write({rest!r})")
            continue
        tree = ast.parse(source)
        if isinstance(tree.body[-1], ast.Expr):
            show = ast.Call(ast.Name("_show", ast.Load()), [tree.body[-1].value], [])
            tree.body[-1] = ast.Expr(show)
        parts.append(ast.unparse(ast.fix_missing_locations(tree)))
    return "\n".join(parts)


@pytest.mark.slow
def test_every_cell_runs_and_violations_can_be_played(tmp_path: Path) -> None:
    (tmp_path / "cells.py").write_text(script(NOTEBOOK.read_text(encoding="utf-8")), encoding="utf-8")
    environment = {"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin", "HOME": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "cells.py"], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=600,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-4000:]
    shown = [line.split()[1:3] for line in done.stdout.splitlines() if line.startswith("CELL ")]
    players = [int(size) for kind, size in shown if kind == "Shown"]
    assert len(players) == 2  # the one of idm, and the one of the reader's own planner
    assert min(players) > 50_000
    assert (tmp_path / "violation.png").read_bytes().startswith(b"\x89PNG")


def test_it_is_kept_without_what_it_printed() -> None:
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in cells)


def test_a_cell_that_fails_ends_the_script(tmp_path: Path) -> None:
    broken = json.dumps({"cells": [{"cell_type": "code", "source": ["1 / 0"]}]})
    done = subprocess.run([sys.executable, "-c", script(broken)], capture_output=True, text=True, check=False)
    assert "ZeroDivisionError" in done.stderr
