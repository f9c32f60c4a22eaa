"""Kills at random moments: continued, the run has the same bytes, and nothing of it is left behind.

Three seeds run with `make test-slow`, fifty with `pytest -m torture` (`make torture`), which prints them;
TSBENCH_TORTURE_SEED=N starts the fifty at N. What is killed and when comes from the seed alone, as far as clocks allow.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from patience import HANG_S
from run_helpers import ROOT, Bench, assert_gone, workers_of

from tsbench.run.log.journal import read_table

FIRST = int(os.environ.get("TSBENCH_TORTURE_SEED", "1000"))
THREE = [pytest.param(seed, marks=pytest.mark.slow) for seed in range(3)]
FIFTY = [pytest.param(seed, marks=pytest.mark.torture) for seed in range(FIRST, FIRST + 50)]
FAKE = ["run", "--planner", "fake_planners:Slow", "--planner", "fake_planners:Raises", "--split", "test"]
FAKE += ["--types", "speed_limit", "--trace", "all", "--workers", "2"]
REAL = ["run", "--planner", "idm", "--split", "test", "--variants", "0", "--limit", "12", "--trace", "all"]
REAL += ["--workers", "2"]
RESULTS = ("episodes.parquet", "violations.parquet")


class Target:
    """A run to attack: how long it takes undisturbed, how often it touches its folder, and what it leaves there."""

    def __init__(self, bench: Bench, command: list[str], code: int, **env: str) -> None:
        self.bench, self.command, self.code, self.env = bench, command, code, env
        began = time.monotonic()
        self.end(self.start("whole", "count:0"))
        self.seconds = time.monotonic() - began
        self.touches = int((bench.folder / "whole.count").read_text())
        self.whole = self.content("whole")

    def start(self, name: str, fault: str = "") -> subprocess.Popen[str]:
        env = self.env | ({"TSBENCH_TEST_FAULT": f"{fault}:{self.bench.folder / name}"} if fault else {})
        return self.bench.start(*self.command, "--out", name, **env)

    def end(self, process: subprocess.Popen[str]) -> str:
        out, err = process.communicate(timeout=HANG_S)
        assert process.returncode == self.code, (out, err)
        assert "Traceback" not in out + err
        return err

    def content(self, name: str) -> dict[str, bytes]:
        """Results and traces by their place in the folder."""
        folder = self.bench.folder / name
        paths = [*(folder / table for table in RESULTS), *sorted((folder / "traces").rglob("*"))]
        return {str(p.relative_to(folder)): p.read_bytes() for p in paths if not p.is_dir()}


def killed_at_a_moment(target: Target, name: str, rng: np.random.Generator, whom: str) -> str:
    """SIGKILL of the run or of a worker, or Ctrl-C, at any time from its start to its end."""
    process = target.start(name)
    moment = float(rng.uniform(0.0, target.seconds))
    slot = int(rng.integers(2))
    try:
        process.wait(moment)
    except subprocess.TimeoutExpired:
        workers = workers_of(process)
        if whom == "run":
            process.kill()
        elif whom == "ctrl-c":
            process.send_signal(signal.SIGINT)
        elif workers:
            os.kill(workers[slot % len(workers)], signal.SIGKILL)
        out, err = process.communicate(timeout=HANG_S)
        assert "Traceback" not in out + err, (out, err)
        assert_gone(workers)
    return f"{whom} killed after {moment:.3f} s of {target.seconds:.3f} s"


def killed_at_a_file(target: Target, name: str, rng: np.random.Generator) -> str:
    """SIGKILL of the run just before it touches a file for the n-th time."""
    touch = int(rng.integers(1, target.touches + 1))
    process = target.start(name, f"kill:{touch}")
    process.communicate(timeout=HANG_S)
    return f"killed before touch {touch} of {target.touches}"


def disk_full(target: Target, name: str, rng: np.random.Generator) -> str:
    """No room from the n-th touch on: one line, exit code 2."""
    touch = int(rng.integers(1, target.touches + 1))
    process = target.start(name, f"full:{touch}")
    workers = workers_of(process)
    out, err = process.communicate(timeout=HANG_S)
    if process.returncode != target.code:
        assert process.returncode == 2, (out, err)
        (line,) = [line for line in err.splitlines() if not line.startswith("note: ")]
        assert "No space left on device; finished episodes are kept" in line
    assert_gone(workers)
    return f"disk full from touch {touch} of {target.touches} on"


def attack(target: Target, seed: int) -> None:
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    kinds: list[Callable[[Target, str, np.random.Generator], str]] = [
        lambda *a: killed_at_a_moment(*a, "run"),
        killed_at_a_file,
        lambda *a: killed_at_a_moment(*a, "worker"),
        disk_full,
        lambda *a: killed_at_a_moment(*a, "ctrl-c"),
    ]
    name = f"seed-{seed}"
    told = kinds[seed % len(kinds)](target, name, rng)
    folder = target.bench.folder / name
    finished, complete = finished_in(folder), status(folder) == "complete"
    err = target.end(target.start(name))
    print(f"seed {seed}: {told}; {finished} episodes were finished; continued to the same bytes")
    if finished and not complete:
        assert f"continuing: {finished} of" in err, (seed, told, err)
    assert target.content(name) == target.whole, f"seed {seed}: {told}"
    assert status(folder) == "complete"
    assert not (folder / "journal.jsonl").exists()
    # A kill leaves at most what the run itself was writing; nothing is lost, and nothing unexplained.
    reasons = folder / "set_aside" / "REASONS.txt"
    aside = {p.name for p in reasons.parent.glob("*-*")} if reasons.exists() else set()
    assert len(aside) <= 5, (seed, told, reasons.read_text())


def status(folder: Path) -> str | None:
    path = folder / "run.json"
    return json.loads(path.read_text())["status"] if path.exists() else None


def finished_in(folder: Path) -> int:
    """Whole episodes in a journal, or in the table of a run that has ended."""
    journal = folder / "journal.jsonl"
    if journal.exists():
        return max(journal.read_bytes().count(b"\n") - 1, 0)
    return len(read_table(folder / "episodes.parquet")) if (folder / "episodes.parquet").exists() else 0


@pytest.fixture(scope="module")
def target(tmp_path_factory: pytest.TempPathFactory, make_data) -> Target:
    folder = tmp_path_factory.mktemp("torture")
    return Target(Bench(make_data(folder / "data"), folder), FAKE, 1)


@pytest.mark.parametrize("seed", [*THREE, *FIFTY])
def test_attacked_and_continued(target: Target, seed: int) -> None:
    attack(target, seed)


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory) -> Target:
    if not (ROOT / "scenarios" / "test.parquet").is_file():
        pytest.skip("no scenarios have been built")
    bench = Bench(ROOT, tmp_path_factory.mktemp("torture-real"))
    return Target(bench, REAL, 0, TSBENCH_TEST_RUNNER="tsbench.episode.runner:EpisodeRunner")


@pytest.mark.torture
@pytest.mark.parametrize("seed", range(FIRST, FIRST + 5))
def test_real_episodes_attacked_and_continued(real: Target, seed: int) -> None:
    attack(real, seed)
