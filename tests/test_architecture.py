"""The house's order: imports go down its layers, no two files import each other, the bench needs no workshop."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from graphlib import TopologicalSorter

import pytest
from import_graph import LAYER, ROOT, imports, modules, package_of

# The bench drives, judges and shows without them; commands and entry points name them.
WORKSHOPS = {"make", "learn", "board", "bridges"}


def test_every_package_has_a_floor() -> None:
    folders = {path.name for path in ROOT.iterdir() if path.is_dir() and any(path.rglob("*.py"))}
    assert folders == set(LAYER)
    alone = {path.name for path in ROOT.glob("*.py")} - {"__init__.py", "__main__.py"}
    assert not alone, f"files beside the packages: {alone}"


def _lower(module: str, name: str) -> bool:
    return LAYER[package_of(name)] < LAYER[package_of(module)]


@pytest.mark.parametrize(
    "forbidden",
    [
        pytest.param(_lower, id="upwards"),
        pytest.param(lambda a, b: {package_of(a), package_of(b)} == {"rules", "planners"}, id="rules and planners"),
        pytest.param(
            lambda a, b: a.startswith("tsbench.planners.experts") and b.startswith("tsbench.planners.floor"),
            id="experts and floors",
        ),
        pytest.param(
            lambda a, b: package_of(b) in WORKSHOPS and package_of(a) not in {*WORKSHOPS, "cli"},
            id="bench and workshops",
        ),
    ],
)
def test_who_may_not_import_whom(forbidden: Callable[[str, str], bool]) -> None:
    pairs = [(module, name) for module, found in imports().items() for name in found]
    named = [(module, name) for module, name in pairs if package_of(module) and package_of(name)]
    assert [f"{module} imports {name}" for module, name in named if forbidden(module, name)] == []


def test_no_class_has_the_name_of_another() -> None:
    places: dict[str, list[str]] = {}
    for path in sorted(ROOT.rglob("*.py")):
        # What nuPlan's planners are given has nuPlan's names.
        if "nuplan" not in path.parts:
            for name in re.findall(r"^ *class ([A-Za-z]\w*)[(:]", path.read_text(encoding="utf-8"), re.MULTILINE):
                places.setdefault(name, []).append(str(path.relative_to(ROOT)))
    assert {name: found for name, found in places.items() if len(found) > 1} == {}


@pytest.mark.parametrize(("library", "owner"), [("libsumo", "tsbench.sim.sumo"), ("ray", "tsbench.run.execution.ray")])
def test_a_library_has_one_door(library: str, owner: str) -> None:
    door = re.compile(rf"^ *(?:import|from) {library}\b", re.MULTILINE)
    assert {name for name, path in modules().items() if door.search(path.read_text(encoding="utf-8"))} == {owner}


def test_no_files_import_each_other_in_a_circle() -> None:
    """Else the error names one."""
    graph = {name: {other for other in found if other != name} for name, found in imports().items()}
    TopologicalSorter(graph).prepare()


# Packages of extras, as if they were not installed; then what starts with the command line, and the rest of the base.
BASE = """
import importlib, sys
sys.modules.update(dict.fromkeys(
    "pandas matplotlib osmnx osmium PIL resvg_py jinja2 statsmodels torch gymnasium ray requests".split()
))
for name in ("cli.run", "cli.planners", "cli.report"):
    importlib.import_module(f"tsbench.{name}")
assert "libsumo" not in sys.modules
for name in ("api.evaluate", "api.drive", "cli.city", "cli.scenarios", "cli.leaderboard"):
    importlib.import_module(f"tsbench.{name}")
"""


@pytest.mark.parametrize(
    "code", [BASE, "import sys, tsbench.report.page.report_server; assert 'libsumo' not in sys.modules"]
)
def test_the_base_needs_no_extra_and_starts_and_makes_reports_without_sumo(code: str) -> None:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
