"""The house's order: imports go down its floors, no two files import each other, no run needs `dataset`."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest

import tsbench

ROOT = Path(tsbench.__file__).parent
# From the top down. Packages of one floor may import each other, as long as no files go in circles.
FLOORS: tuple[frozenset[str], ...] = tuple(
    map(
        frozenset,
        (
            {"cli"},
            {"tools", "learn", "envs", "report"},
            {"dataset", "run"},
            {"metrics"},
            {"episode"},
            {"planners", "rules"},
            {"scenarios"},
            {"sim"},
            {"roads", "signs"},
            {"geometry", "data"},
            {"core"},
        ),
    )
)
FLOOR = {package: number for number, floor in enumerate(FLOORS) for package in floor}
# What is left out of an installation without the extra `make`: only who makes or shows data may ask for it.
MAY_IMPORT_DATASET = {"dataset", "cli", "learn", "report", "tools"}


@cache
def modules() -> dict[str, Path]:
    """Dotted names of all modules of tsbench and their files."""
    found = {}
    for path in sorted(ROOT.rglob("*.py")):
        parts = path.relative_to(ROOT.parent).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@cache
def imports() -> dict[str, tuple[tuple[str, bool], ...]]:
    """Who imports what: for each module the modules of tsbench that it names, and whether at import time."""
    return {name: tuple(_imported(path)) for name, path in modules().items()}


def _imported(path: Path) -> list[tuple[str, bool]]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    inside = {
        id(node)
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef)
        for node in ast.walk(function)
    }
    # For the reader of types only: nothing is imported.
    inside_types = {
        id(node)
        for test in ast.walk(tree)
        if isinstance(test, ast.If) and "TYPE_CHECKING" in ast.unparse(test.test)
        for node in ast.walk(test)
    }
    found = []
    for node in ast.walk(tree):
        if id(node) in inside_types:
            continue
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert not node.level, f"{path}: relative import"
            names = [_module_of(node.module, alias.name) for alias in node.names]
        else:
            continue
        found += [(name, id(node) not in inside) for name in names if name in modules()]
    return found


def _module_of(module: str, name: str) -> str:
    return f"{module}.{name}" if f"{module}.{name}" in modules() else module


def package_of(module: str) -> str:
    """The floor's package of a module; "" for tsbench itself, which shows the public names of all."""
    return module.split(".")[1] if "." in module else ""


def test_every_package_has_a_floor() -> None:
    folders = {path.name for path in ROOT.iterdir() if path.is_dir() and any(path.rglob("*.py"))}
    assert folders == set(FLOOR)
    alone = {path.name for path in ROOT.glob("*.py")} - {"__init__.py"}
    assert not alone, f"files beside the packages: {alone}"


def test_imports_go_down_only() -> None:
    upwards = [
        f"{module} imports {name}"
        for module, found in imports().items()
        for name, _ in found
        if package_of(module) and package_of(name) and FLOOR[package_of(name)] < FLOOR[package_of(module)]
    ]
    assert not upwards, "\n".join(upwards)


def test_rules_and_planners_do_not_know_each_other() -> None:
    crossing = [
        f"{module} imports {name}"
        for module, found in imports().items()
        for name, _ in found
        if {package_of(module), package_of(name)} == {"rules", "planners"}
    ]
    assert not crossing, "\n".join(crossing)


def test_nothing_that_runs_imports_what_makes_data() -> None:
    running = [
        f"{module} imports {name}"
        for module, found in imports().items()
        for name, at_import in found
        if package_of(name) == "dataset" and package_of(module) not in MAY_IMPORT_DATASET
    ]
    assert not running, "\n".join(running)


@pytest.mark.parametrize(
    ("library", "owner"), [("libsumo", "tsbench.sim.sumo"), ("ray", "tsbench.run.execution.ray")]
)
def test_a_library_has_one_door(library: str, owner: str) -> None:
    users = [
        name
        for name, path in modules().items()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if (isinstance(node, ast.Import) and any(a.name.split(".")[0] == library for a in node.names))
        or (isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == library)
    ]
    assert set(users) == {owner}


def test_no_files_import_each_other_in_a_circle() -> None:
    graph = {name: sorted({n for n, _ in found if n != name}) for name, found in imports().items()}
    circles = [group for group in _components(graph) if len(group) > 1]
    assert not circles, "\n".join(" <-> ".join(sorted(group)) for group in circles)


def test_the_circle_finder_finds_circles() -> None:
    found = _components({"a": ["b"], "b": ["c"], "c": ["a"], "d": ["a"]})
    assert sorted(map(sorted, found)) == [["a", "b", "c"], ["d"]]


def _components(graph: dict[str, list[str]]) -> list[list[str]]:
    """Strongly connected components (Tarjan), without recursion limits in the way of a few hundred files."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in graph.get(node, ()):
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            cut = stack.index(node)
            found.append(stack[cut:])
            del stack[cut:]

    for node in sorted(graph):
        if node not in index:
            visit(node)
    return found
