"""The notebooks of the documentation, cell by cell in one process, as a reader runs them."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from patience import HANG_S

ROOT = Path(__file__).resolve().parents[2]
GUIDES = ROOT / "docs/guides"
# What is smaller in a test than for a reader, in the notebook that learns.
SMALLER = {"--limit 120": "--limit 6", "EPOCHS = 12": "EPOCHS = 2"}
# The last value of a cell is shown: as HTML where it has a way to.
SHOW = """
def _show(value):
    print("CELL", type(value).__name__, len(value._repr_html_()) if hasattr(value, "_repr_html_") else repr(value))
"""


def script(notebook: str) -> str:
    """The code cells in their order as one script; `%%writefile NAME` writes what follows, `!` begins a command."""
    parts = [SHOW]
    for cell in json.loads(notebook)["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] != "code":
            continue
        first, _, rest = source.partition("\n")
        if first.startswith("%%writefile "):
            parts.append(f"open({first.split()[1]!r}, 'w').write({rest!r})")
            continue
        tree = ast.parse(re.sub(r"^!(.*)$", _command, source, flags=re.MULTILINE))
        if isinstance(tree.body[-1], ast.Expr):
            show = ast.Call(ast.Name("_show", ast.Load()), [tree.body[-1].value], [])
            tree.body[-1] = ast.Expr(show)
        parts.append(ast.unparse(ast.fix_missing_locations(tree)))
    return "\n".join(parts)


def _command(line: re.Match[str]) -> str:
    return f"_ = __import__('subprocess').run({line[1]!r}, shell=True, check=True)"


def shown_by(notebook: str, folder: Path) -> list[list[str]]:
    """Of each value that a cell of this script ends with: its type, and how long its HTML is, or what it is."""
    (folder / "cells.py").write_text(notebook, encoding="utf-8")
    commands = f"{Path(sys.executable).parent}:/usr/bin:/bin"
    environment = {"PYTHONPATH": str(ROOT), "PATH": commands, "HOME": str(folder), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "cells.py"], cwd=folder, env=environment, capture_output=True, text=True, timeout=HANG_S,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-4000:]
    return [line.split(maxsplit=2)[1:] for line in done.stdout.splitlines() if line.startswith("CELL ")]


@pytest.mark.slow
def test_the_first_run_ends_in_violations_that_can_be_played(tmp_path: Path) -> None:
    shown = shown_by(script((GUIDES / "first_run.ipynb").read_text(encoding="utf-8")), tmp_path)
    players = [int(size) for kind, size in shown if kind == "Shown"]
    assert len(players) == 2  # the one of idm, and the one of the reader's own planner
    assert min(players) > 50_000
    assert (tmp_path / "violation.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_what_is_cloned_from_the_oracle_learns_and_is_scored(tmp_path: Path) -> None:
    cells = script((GUIDES / "learn_from_drives.ipynb").read_text(encoding="utf-8"))
    for whole, smaller in SMALLER.items():
        assert cells.count(whole) == 1
        cells = cells.replace(whole, smaller)
    ticks, losses, figures, violations = shown_by(cells, tmp_path)
    assert int(ticks[1]) > 6 * 50
    first, last = ast.literal_eval(losses[1])
    assert last < first
    assert figures[0] == violations[0] == "DataFrame"
    run = json.loads((tmp_path / "runs/clone/run.json").read_text(encoding="utf-8"))
    assert run["status"] == "complete"
    assert {planner["name"] for planner in run["planners"]} == {"Policy", "idm"}


@pytest.mark.parametrize("notebook", sorted(GUIDES.glob("*.ipynb")), ids=lambda path: path.stem)
def test_it_is_kept_without_what_it_printed(notebook: Path) -> None:
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in cells)
