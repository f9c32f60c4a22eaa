"""`tsbench failures` on run folders made by hand."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from command_line import in_process, refused
from run_builders import episodes, failed, make_run

END = {"scd": False, "outcome": "timeout", "duration_s": 30.0}


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.chdir(tmp_path)
    return in_process("failures", capsys)


def test_a_list_for_readers_and_for_programs(run, tmp_path: Path) -> None:
    make_run(tmp_path / "x", episodes("idm", yield_m0_v0=END, speed_limit_m1_v0=failed("ValueError: π")))
    out, _ = run("x", "--by", "clause")
    assert out.startswith("error: 1 of 2 failures\n  idm/speed_limit-m1-v0\n    signed 2.4, planner_error, error: Va")
    (first, second) = json.loads(run("x", "--json")[0])
    assert first["sentence"] == "ValueError: π"
    assert second == {
        "planner": "idm", "scenario_id": "yield-m0-v0", "half": "signed", "outcome": "timeout", "type": "yield",
        "plate": "2.4", "cause": "timeout", "sentence": "At 30.0 s the time was up, after 100 % of its way.",
    }  # fmt: skip


def test_nothing_failed(run, tmp_path: Path) -> None:
    make_run(tmp_path / "x", episodes("idm"))
    assert run("x")[0] == "x: none of its 48 episodes failed\n"
    assert json.loads(run("x", "--json")[0]) == []


def test_a_run_with_holes(run, tmp_path: Path) -> None:
    make_run(tmp_path / "x", episodes("idm", yield_m0_v0=END), asked=50)
    assert "scenarios without a record (idm: 2 of 50): continue the run" in refused(run, "x")
    out, _ = run("x", "--allow-partial")
    assert out.startswith("PARTIAL, scenarios without a record (idm: 2 of 50)\nidm: 1 of 48 episodes failed")


def test_no_run(run) -> None:
    assert "gone: no run folder" in refused(run, "gone")
