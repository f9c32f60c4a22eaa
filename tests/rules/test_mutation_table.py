"""`make mutation`: how its mutants are counted, and whether its copy of the tests finds what they read."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from mutation_table import count, faults, table

ROOT = Path(__file__).resolve().parents[2]


def _results(killed: int, survived: int, timeout: int = 0, untried: int = 0) -> list[str]:
    ends = ["killed"] * killed + ["survived"] * survived + ["timeout"] * timeout + ["not checked"] * untried
    return [f"    tsbench.rules.stop.xǁStopǁstep__mutmut_{k}: {end}" for k, end in enumerate(ends)]


def test_mutants_are_counted_by_file() -> None:
    other = "    tsbench.rules.wrong_way.x_posted_kmh__mutmut_1: no tests"
    head, stop, other_file, total = table(count([*_results(16, 3, 1), other, ""]))
    assert head.split() == ["file", "mutants", "caught", "survived", "timeouts", "share"]
    assert stop.split() == ["tsbench/rules/stop.py", "20", "17", "3", "1", "85.0%"]
    assert other_file.split() == ["tsbench/rules/wrong_way.py", "1", "0", "1", "0", "0.0%"]
    assert total.split() == ["all", "21", "17", "4", "1", "81.0%"]


def test_too_few_caught_and_untried_mutants_are_faults() -> None:
    assert faults(count(_results(18, 2))) == []
    assert faults(count(_results(17, 2, 1))) == []
    assert faults(count(_results(89, 11))) == ["all: 89.0% of the mutants are caught, less than 90%"]
    assert "2 mutants were not tried" in faults(count(_results(20, 0, untried=2)))[0]
    assert faults(count([])) == ["no mutants: run mutmut first"]


def test_a_file_may_fall_behind_by_a_little_only() -> None:
    caught = ["    tsbench.rules.wrong_way.x_posted_kmh__mutmut_1: killed"] * 3
    missed = "    tsbench.rules.wrong_way.x_posted_kmh__mutmut_2: survived"
    assert faults(count([*_results(40, 0), *caught, missed])) == []
    assert faults(count([*_results(40, 0), *caught, missed, missed])) == [
        "tsbench.rules.wrong_way: 60.0% of the mutants are caught, less than 75%"
    ]


@pytest.mark.slow
def test_the_copied_tests_find_all_that_they_read(tmp_path: Path) -> None:
    """mutmut runs them in a folder that has its sources, the tests and what `also_copy` names.

    Some that read files of each kind: cases of signs, roads made by netconvert, crops of scenes.
    """
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["mutmut"]
    heavy = shutil.ignore_patterns("*.safetensors")
    for name in (*settings["source_paths"], *settings["also_copy"], "tests", "pyproject.toml"):
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, tmp_path / name, ignore=heavy)
        else:
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, tmp_path / name)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", *settings["pytest_add_cli_args"],
         "-k", "twice_without_a_stop or cut or (crop and yield)", *settings["pytest_add_cli_args_test_selection"]],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(tmp_path)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
