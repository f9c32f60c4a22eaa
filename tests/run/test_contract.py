"""The contract covers the code that makes records, all of it, and nothing that only reads them."""

from __future__ import annotations

import ast
from pathlib import Path

import tsbench
from tsbench.run.contract import CODE

ROOT = Path(tsbench.__file__).parent
PREFIX = "tsbench.metrics."


def imported(path: Path) -> set[str]:
    """Modules of tsbench.metrics that a file imports, by name."""
    nodes = ast.walk(ast.parse(path.read_text()))
    names = [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]
    return {name.removeprefix(PREFIX) for name in names if name.startswith(PREFIX)}


def test_every_metric_of_a_record_is_in_the_contract() -> None:
    todo = imported(ROOT / "run" / "score.py") | imported(ROOT / "run" / "episode.py")
    found: set[str] = set()
    while todo:
        name = todo.pop()
        found.add(name)
        todo |= imported(ROOT / "metrics" / f"{name}.py") - found
    assert {"episode", "comfort", "fault"} <= found
    assert {f"metrics/{name}.py" for name in found} == {part for part in CODE if part.startswith("metrics")}


def test_what_the_contract_names_is_there() -> None:
    assert all((ROOT / part).exists() for part in CODE)
