"""Benches of the harness's parts: an episode in a child of its worker, and a planner in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest
from patience import HANG_S
from scripts import FOLDER, load_script


def test_it_drives_both_ways() -> None:
    # A process whose other children may be killed.
    command = [sys.executable, FOLDER / "benches.py", "fresh", "--limit", "2", "--rounds", "1"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=HANG_S)
    assert done.returncode == 0, done.stderr
    price = json.loads(done.stdout)["blind"]
    assert price.keys() == {"together_ms", "in_child_ms"}
    # Children drive the episodes, too.
    assert price["in_child_ms"] > 0.5 * price["together_ms"] > 0.0


def test_it_measures_both_ways_and_leaves_the_process_where_it_may_run() -> None:
    before = os.sched_getaffinity(0)
    price = load_script("benches").isolation("idm", scenes=1, rounds=1)
    assert 0.0 < price["together_us"] < price["isolated_us"]
    assert os.sched_getaffinity(0) == before


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["vector", "scene"])
def test_the_environment_is_measured_alone_and_vectorised(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    benches = load_script("benches")
    monkeypatch.setattr(benches, "BLOCK", 40)
    rates = benches.environment(kind, steps=40)
    assert 0.0 < rates["with_starts"] <= rates["steps_per_s"]
    assert rates["vectorised"] > 0.0
