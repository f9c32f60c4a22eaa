"""`tsbench train`: what it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest
from command_line import in_process, refused

pytestmark = pytest.mark.slow


def test_a_fine_tuning_without_drives_or_base_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    train = in_process("train", capsys)
    out = ("--out", str(tmp_path / "out"))
    missing = refused(train, "frames", "--trajectories", str(tmp_path / "none.parquet"), *out)
    assert "none.parquet" in missing
    (tmp_path / "empty").mkdir()
    base = refused(train, "plant2-ft", "--planner", "idm-e", "--base", str(tmp_path / "empty"), *out)
    assert "plant2.json" in base
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("planner", ["ppo", "carl", "plant2-ft"])
def test_types_to_draw_more_often_are_checked_before_anything_starts(
    planner: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    told = refused(in_process("train", capsys), planner, "--more", "yeild", "--out", str(tmp_path / "out"))
    assert told.startswith("error: --more yeild: no such type or group (did you mean yield?): groups are")
    assert not (tmp_path / "out").exists()


def test_measure_refuses_what_is_not_there(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    train = in_process("train", capsys)
    assert "plant2-ft.json" in refused(train, "measure", str(tmp_path))
    assert "--stop-policy" in refused(
        train, "measure", "--planner", "plant2", "--stop-policy", "0.1", "5", "0.02", "0", "3"
    )


def test_measure_says_how_weights_drive_by_type(capsys: pytest.CaptureFixture[str]) -> None:
    """tsbench's own weights keep limits on maps that they were not made from; who always halts does not arrive."""
    train = in_process("train", capsys)
    few = ("measure", "--types", "speed_limit,zone_speed_limit", "--each", "1", "--workers", "1")
    told, _ = train(*few)
    assert "SCD 100.0 %" in told
    assert [line.split()[:2] for line in told.splitlines() if "speed_limit" in line] == [
        ["speed_limit", "1"],
        ["zone_speed_limit", "1"],
    ]
    assert "SCD 0.0 %" in train(*few, "--stop-policy", "0", "5", "0", "0", "3")[0]
