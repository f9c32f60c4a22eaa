"""Benches of the harness: an episode in a child of its worker, and a planner in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import in_process, refused
from patience import HANG_S

from tsbench.cli import benches
from tsbench.cli.benches import Price


def test_it_drives_both_ways(tmp_path: Path) -> None:
    file = tmp_path / "price.json"
    # A process whose other children may be killed.
    command = [sys.executable, "-m", "tsbench", "bench", "--fresh", "--limit", "2", "--rounds", "1", "--json"]
    done = subprocess.run([*command, str(file)], capture_output=True, text=True, check=False, timeout=HANG_S)
    assert done.returncode == 0, done.stderr
    assert "goal: 15" in done.stdout
    price = json.loads(file.read_text())
    assert price.keys() == {"together_ms", "in_child_ms"}
    # Children drive the episodes, too.
    assert price["in_child_ms"] > 0.5 * price["together_ms"] > 0.0


@pytest.mark.parametrize(("in_child", "said"), [(62.0, "met"), (66.0, "not met")])
def test_it_says_whether_the_goal_for_fresh_episodes_is_met(
    in_child: float, said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(benches, "bench_fresh", lambda *_: {"together_ms": 50.0, "in_child_ms": in_child})
    out, _ = in_process("bench", capsys)("--fresh")
    figures = next(line for line in out.splitlines() if f"{in_child:.1f}" in line)
    assert figures.split() == ["50.0", f"{in_child:.1f}", f"{in_child - 50.0:.1f}", *said.split()]


def test_it_measures_both_ways_and_leaves_the_process_where_it_may_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before, file = os.sched_getaffinity(0), tmp_path / "price.json"
    out, _ = in_process("bench", capsys)(
        "--isolation", "--planner", "idm", "--limit", "1", "--rounds", "1", "--json", str(file)
    )
    assert "goal: 150" in out
    price = json.loads(file.read_text())["idm"]
    assert 0.0 < price["together_us"] < price["isolated_us"]
    assert os.sched_getaffinity(0) == before


@pytest.mark.parametrize(("isolated", "said"), [(160.0, "met"), (190.0, "not met")])
def test_it_says_whether_the_goal_for_isolation_is_met(
    isolated: float, said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    prices = [Price("idm", 20.0, isolated, 200.0), Price("program", None, 26.0, 80.0)]
    monkeypatch.setattr(benches, "bench_isolation", lambda *_: prices)
    out, _ = in_process("bench", capsys)("--isolation")
    words = {line.split()[0]: line for line in out.splitlines() if line.strip()}
    assert f" {isolated - 20.0:.0f} " in words["idm"]
    assert words["idm"].split()[4:-1] == said.split()
    assert words["program"].split() == ["program", "-", "26", "-", "-", "80"]


def test_a_planner_is_named_with_isolation_only(capsys: pytest.CaptureFixture[str]) -> None:
    assert "--isolation" in refused(in_process("bench", capsys), "--planner", "idm")
