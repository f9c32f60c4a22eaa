"""`tsbench bench --isolation`: what a process of a planner's own costs, and whether that is within the goal."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from command_line import in_process, refused

from tsbench.tools import bench_isolation
from tsbench.tools.bench_isolation import Price


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
def test_it_says_whether_the_goal_is_met(
    isolated: float, said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    prices = [Price("idm", 20.0, isolated, 200.0), Price("program", None, 26.0, 80.0)]
    monkeypatch.setattr(bench_isolation, "bench_isolation", lambda *_: prices)
    out, _ = in_process("bench", capsys)("--isolation")
    words = {line.split()[0]: line for line in out.splitlines() if line.strip()}
    assert f" {isolated - 20.0:.0f} " in words["idm"]
    assert words["idm"].split()[4:-1] == said.split()
    assert words["program"].split() == ["program", "-", "26", "-", "-", "80"]


def test_a_planner_is_named_with_isolation_only(capsys: pytest.CaptureFixture[str]) -> None:
    assert "--isolation" in refused(in_process("bench", capsys), "--planner", "idm")
