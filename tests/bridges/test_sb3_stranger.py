"""What somebody does who has only the guide: train by its lines, make a planner, run it; and copy the example."""

from __future__ import annotations

import csv
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from patience import HANG_S, eventually

ROOT = Path(__file__).resolve().parents[2]
TSBENCH = (sys.executable, "-c", "from tsbench.cli import main; main()")
# PPO's own rollout: less is not learned from. The example's rollouts are shortened.
DECISIONS, SHORT = 2048, 256
# A training takes long where many processes share a core.
PATIENCE_S = 3 * HANG_S
# Threads of torch wait for each other by spinning, beside all other tests.
CALM = {**os.environ, "OMP_NUM_THREADS": "1"}
EXAMPLE = """
import sys

sys.path.insert(0, {examples!r})
import train_sb3

train_sb3.EVERY_S = 0.0
train_sb3.ROLLOUT = {short}
train_sb3.main()
"""


def said(command: tuple[str, ...], folder: Path) -> str:
    # Stable-Baselines3's logger makes its folder there, and not in /tmp.
    env = {**CALM, "SB3_LOGDIR": str(folder / "sb3")}
    done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def drives_three_pairs(command: str, folder: Path) -> None:
    """The command that was printed, on three pairs: no episode breaks off."""
    words = command.split()
    assert words[:3] == ["tsbench", "run", "--planner"]
    said((*TSBENCH, *words[1:], "--limit", "6", "--workers", "1", "--out", "run"), folder)
    table = pq.read_table(folder / "run" / "episodes.parquet")
    assert len(table) == 6
    assert set(table["outcome"].to_pylist()) <= {"arrived", "collision", "off_road", "timeout"}
    assert json.loads((folder / "run" / "run.json").read_text())["status"] == "complete"


@pytest.mark.slow
@pytest.mark.timeout(PATIENCE_S)
def test_the_guides_lines_give_a_planner_that_runs(tmp_path: Path) -> None:
    guide = (ROOT / "docs" / "env.md").read_text(encoding="utf-8")
    (script,) = re.findall(r"```python\n# learn\.py\n(.*?)```", guide, re.S)
    assert "1_000_000" in script
    (tmp_path / "learn.py").write_text(script.replace("1_000_000", str(DECISIONS)), encoding="utf-8")
    said((sys.executable, "learn.py"), tmp_path)
    told = said((*TSBENCH, "planners", "from-sb3", "model.zip"), tmp_path)
    assert "sees scene, acts by exit" in told
    command = told.splitlines()[-1]
    assert f"{command}\n```" in guide
    drives_three_pairs(command, tmp_path)


@pytest.mark.slow
@pytest.mark.timeout(PATIENCE_S)
def test_the_example_goes_on_after_it_was_killed(tmp_path: Path) -> None:
    code = EXAMPLE.format(examples=str(ROOT / "examples"), short=SHORT)
    command = (sys.executable, "-c", code, "--group", "speed", "--workers", "1", "--out", str(tmp_path / "out"))
    curve = tmp_path / "out" / "curve.csv"

    def steps() -> list[int]:
        with curve.open() as file:
            return [int(row["steps"]) for row in csv.DictReader(file)]

    process = subprocess.Popen((*command, "--steps", "1000000"), cwd=tmp_path, env=CALM, start_new_session=True)
    eventually(lambda: curve.is_file() and bool(steps()), process, PATIENCE_S)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    before = steps()
    said((*command, "--steps", str(before[-1] + SHORT)), tmp_path)
    assert steps()[: len(before)] == before
    assert steps()[-1] == before[-1] + SHORT
    assert steps() == sorted(steps())
    assert (tmp_path / "out" / "curve.png").is_file()
    assert not (tmp_path / "sb3").exists()
    told = said((*TSBENCH, "planners", "from-sb3", "out/model.zip"), tmp_path)
    assert "sees plates, acts by cruise, a decision each 3 ticks" in told
    drives_three_pairs(told.splitlines()[-1], tmp_path)
