"""`tsbench bench --fresh`: what a child for each episode costs, and whether that is within the goal."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import in_process
from patience import HANG_S

from tsbench.tools import bench_fresh
from tsbench.tools.bench_fresh import FreshPrice


def test_it_drives_both_ways(tmp_path: Path) -> None:
    file = tmp_path / "price.json"
    # A process whose other children may be killed.
    command = [sys.executable, "-m", "tsbench", "bench", "--fresh", "--limit", "2", "--rounds", "1", "--json"]
    done = subprocess.run([*command, str(file)], capture_output=True, text=True, check=False, timeout=HANG_S)
    assert done.returncode == 0, done.stderr
    assert "goal: 15" in done.stdout
    price = json.loads(file.read_text())
    assert price.keys() == {"together_ms", "in_child_ms"}
    assert min(price.values()) > 0.0


@pytest.mark.parametrize(("in_child", "said"), [(62.0, "met"), (66.0, "not met")])
def test_it_says_whether_the_goal_is_met(
    in_child: float, said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench_fresh, "bench_fresh", lambda *_: FreshPrice(50.0, in_child))
    out, _ = in_process("bench", capsys)("--fresh")
    figures = next(line for line in out.splitlines() if f"{in_child:.1f}" in line)
    assert figures.split() == ["50.0", f"{in_child:.1f}", f"{in_child - 50.0:.1f}", *said.split()]
