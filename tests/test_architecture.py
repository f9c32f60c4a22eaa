"""The house's order: imports go down its layers, no two files import each other, no run needs `dataset`."""

from __future__ import annotations

import ast

import pytest
from import_graph import LAYER, ROOT, imports, modules, package_of

# What is left out of an installation without the extra `make`: only who makes or shows data may ask for it.
MAY_IMPORT_DATASET = {"dataset", "cli", "learn", "report", "tools"}


def test_every_package_has_a_floor() -> None:
    folders = {path.name for path in ROOT.iterdir() if path.is_dir() and any(path.rglob("*.py"))}
    assert folders == set(LAYER)
    alone = {path.name for path in ROOT.glob("*.py")} - {"__init__.py", "__main__.py"}
    assert not alone, f"files beside the packages: {alone}"


def test_imports_go_down_only() -> None:
    upwards = [
        f"{module} imports {name}"
        for module, found in imports().items()
        for name, _ in found
        if package_of(module) and package_of(name) and LAYER[package_of(name)] < LAYER[package_of(module)]
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


def test_experts_do_not_know_the_floor() -> None:
    crossing = [
        f"{module} imports {name}"
        for module, found in imports().items()
        for name, _ in found
        if module.startswith("tsbench.planners.experts") and name.startswith("tsbench.planners.floor")
    ]
    assert not crossing, "\n".join(crossing)


def test_no_class_has_the_name_of_another() -> None:
    places: dict[str, list[str]] = {}
    for path in sorted(ROOT.rglob("*.py")):
        # What nuPlan's planners are given has nuPlan's names.
        if "nuplan" not in path.parts:
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    places.setdefault(node.name, []).append(str(path.relative_to(ROOT)))
    assert {name: found for name, found in places.items() if len(found) > 1} == {}


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
