"""Where a package of an extra is missing, one line says how to install it."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from tsbench.cli import SECTIONS, main
from tsbench.core.errors import EXTRA_OF

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
def test_each_module_is_of_a_package_that_its_extra_brings() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    brought = packages_distributions()
    for module, extra in EXTRA_OF.items():
        asked = {line.partition(">=")[0] for line in project["optional-dependencies"][extra]}
        packages = {name.lower().replace("_", "-") for name in brought[module]}
        assert asked & packages, f"{module}: {extra}"
        assert not {line.partition(">=")[0] for line in project["dependencies"]} & packages


def test_a_command_without_its_extra_is_one_line() -> None:
    # In a process of its own: here everything has been imported already.
    code = "import sys; sys.modules['matplotlib'] = sys.modules['PIL'] = None; from tsbench.cli import main; main()"
    ended = subprocess.run(
        [sys.executable, "-c", code, "render", "nowhere", "idm/x"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert ended.returncode == 2
    assert ended.stderr.count("\n") == 1
    assert ended.stderr.endswith("which is not installed: pip install 'tsbench[report]'\n")


@pytest.mark.slow
def test_a_picture_of_the_environment_names_its_extra() -> None:
    code = """import sys; sys.modules['resvg_py'] = None
import gymnasium
made = gymnasium.make("tsbench.learn.envs:tsbench/Drive-v1", split="dev", render_mode="rgb_array")
made.reset(seed=0); made.render()"""
    ended = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.stderr.endswith("this needs resvg_py, which is not installed: pip install 'tsbench[report]'\n")


def test_a_module_of_no_extra_is_no_bad_input(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SECTIONS["Bring a planner of your own"], "bench", ("tsbench.no_such_module:x", ""))
    with pytest.raises(ModuleNotFoundError):
        main(["bench"])
