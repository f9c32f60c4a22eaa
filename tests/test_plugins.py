"""The suite's own plugins: who is too large is named, and a test may have a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from patience import HANG_S

HERE = Path(__file__).parent / "helpers"
CONFTEST = f"""
import sys
sys.path.insert(0, {str(HERE)!r})
import memory_guard
pytest_plugins = ["memory_guard", "own_process"]
memory_guard.MOST_MB = @MOST@
def pytest_configure(config):
    config.addinivalue_line("markers", "own_process: alone")
"""
SUITE = """
import os, pytest

HELD = []

def test_small():
    pass

def test_large():
    HELD.append(b"x" * 200_000_000)

def test_after():
    assert HELD
"""
ALONE = """
import os, pathlib, pytest

ABOVE = os.environ.get("PID_ABOVE")
os.environ.setdefault("PID_ABOVE", str(os.getpid()))

@pytest.mark.own_process
@pytest.mark.parametrize("good", [True, False])
def test_alone(good, tmp_path):
    assert ABOVE and str(os.getpid()) != ABOVE
    assert good, "this one is bad"

def test_here():
    assert not ABOVE
"""


def run_suite(folder: Path, text: str, most_mb: float) -> tuple[int, str]:
    """Exit code and output of pytest on one module, with the plugins."""
    (folder / "conftest.py").write_text(CONFTEST.replace("@MOST@", str(most_mb)))
    (folder / "test_it.py").write_text(text)
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:xdist",
        "-p",
        "no:cacheprovider",
        "-c",
        os.devnull,
    ]
    done = subprocess.run(
        [*command, "--rootdir", str(folder), str(folder)],
        cwd=folder,
        env={**os.environ, "PYTEST_XDIST_WORKER": "gw0"},
        text=True,
        capture_output=True,
        timeout=HANG_S,
    )
    return done.returncode, done.stdout + done.stderr


def test_who_makes_a_process_too_large_is_named(tmp_path: Path) -> None:
    code, told = run_suite(tmp_path, SUITE, 200.0)
    assert code == 1, told
    assert "ERROR test_it.py::test_large" in told
    assert "test_it.py::test_large: this worker of the suite has held" in told
    assert ("3 passed" in told, "1 error" in told) == (True, True)


def test_who_stays_small_is_not(tmp_path: Path) -> None:
    code, told = run_suite(tmp_path, SUITE, 700.0)
    assert (code, "3 passed" in told) == (0, True), told


def test_imports_that_are_too_large_are_named(tmp_path: Path) -> None:
    code, told = run_suite(tmp_path, "X = b'x' * 200_000_000\n" + SUITE, 150.0)
    assert code != 0
    assert "collecting the tests: this worker of the suite has held" in told


def test_a_test_in_a_process_of_its_own_passes_or_says_why(tmp_path: Path) -> None:
    code, told = run_suite(tmp_path, ALONE, 700.0)
    assert code == 1, told
    assert "2 passed" in told
    assert "1 failed" in told
    assert "in a process of its own (exit code 1)" in told
    assert "this one is bad" in told


@pytest.mark.own_process
def test_it_is_at_work_here() -> None:
    assert "TSBENCH_TEST_IN_OWN_PROCESS" in os.environ
