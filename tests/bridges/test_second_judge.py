"""A judge that others wrote, over exported episodes, in its own environment (.venv/judge, .venv/commonroad)."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tsbench.cli import main

JUDGE, COMMONROAD = (Path(sys.prefix) / name for name in ("judge", "commonroad"))
HANG_S = 600.0
TYPES = ("speed_limit", "stop")


@pytest.mark.slow
def test_both_judges_agree_on_drives_that_keep_and_break_limits_and_stops(tmp_path: Path) -> None:
    if not (JUDGE / "crmonitor").is_dir():
        pytest.skip(f"CommonRoad's monitor is not in {JUDGE} (make judge puts it there, from a package index)")
    run = tmp_path / "run"
    drivers = ("--planner", "idm", "--planner", "idm-e", "--workers", "1", "--trace", "all")
    with pytest.raises(SystemExit) as ended:
        main(["run", "--split", "dev", "--types", ",".join(TYPES), "--limit", "4", *drivers, "--out", str(run)])
    assert ended.value.code == 0
    environment = {**os.environ, "PYTHONPATH": f"{JUDGE}:{COMMONROAD}", "PYTHONWARNINGS": "ignore"}
    done = subprocess.run(
        [sys.executable, "-m", "tsbench.bridges.second_judge", run],
        capture_output=True, text=True, env=environment, timeout=HANG_S, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    with (run / "second_judge" / "agreement.csv").open(encoding="utf-8") as file:
        cases = list(csv.DictReader(file))
    assert {case["clause"] for case in cases} == {"over_limit", "no_full_stop"}
    for clause in ("over_limit", "no_full_stop"):
        assert {case["ours"] for case in cases if case["clause"] == clause} == {"True", "False"}
    # With our thresholds in its formulas it sees what our monitors see, in each of the episodes.
    assert [case for case in cases if case["theirs_ours"] != case["ours"]] == []
    assert all(case["why"] != "not explained" for case in cases)


def test_without_its_packages_one_line_says_so(tmp_path: Path) -> None:
    without = "import sys; sys.modules['crmonitor'] = None; sys.argv = ['second_judge', 'nowhere']"
    code = f"{without}; import runpy; runpy.run_module('tsbench.bridges.second_judge', run_name='__main__')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "commonroad-stl-monitor in an environment of its own (docs/second_judge.md)" in line
