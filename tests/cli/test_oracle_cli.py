"""`tsbench oracle`: what it refuses, and what it prints of a table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command_line import Command, in_process, refused

from tsbench.learn.oracle.trajectories import Recorded, write_trajectories
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import ScenarioSpec

NO_TABLE = (
    "no such table (tsbench data fetch --from DIR|URL oracle brings the released one, tsbench oracle select makes one)"
)


@pytest.fixture
def oracle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    return in_process("oracle", capsys)


@pytest.fixture(scope="module")
def rows() -> list[ScenarioSpec]:
    """The test split's table: the smaller one."""
    return DataSet().table("test")


def drive(scenario: str, planner: str, rank: int) -> Recorded:
    return Recorded(
        scenario, planner, attempt=0, part="train", rank=rank, quality=0.9, comfort=1.0,
        commands=np.zeros((36, 2), dtype=np.int16), intents=(), ego="0" * 16, others="0" * 16,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["collect", "--learned-variants", "3"], "--learned-variants"),
        (["collect", "--types", "nonsense"], "--types nonsense: no such type or group"),
        (["collect", "--types", "yield", "--limit", "1", "--out", "mine"], "mine: is neither empty nor a collection"),
        (["select", "nowhere"], "nowhere/run.json: no collection (tsbench oracle collect makes one)"),
        (["stats", "--trajectories", "none.parquet"], f"none.parquet: {NO_TABLE}"),
        (["verify", "--trajectories", "none.parquet"], f"none.parquet: {NO_TABLE}"),
    ],
)
def test_refusals_are_one_line(oracle: Command, tmp_path: Path, arguments: list[str], told: str) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("not to be lost")
    assert told in refused(oracle, *arguments)


def test_only_experts_are_asked(oracle: Command, tmp_path: Path) -> None:
    """A sign-blind planner is none; nothing is left behind."""
    told = refused(oracle, "collect", "--types", "bus_lane_road", "--limit", "1", "--planner", "idm", "--workers", "1")
    assert "--planner idm: is no expert" in told
    assert not (tmp_path / "runs").exists()


def test_stats_prints_and_writes(oracle: Command, tmp_path: Path, rows: list[ScenarioSpec]) -> None:
    """One scenario with two drives, another with one."""
    first, second = rows[0].scenario_id, rows[-1].scenario_id
    drives = [drive(first, "idm-e", 1), drive(first, "ppo-e", 2), drive(second, "idm-e", 1)]
    write_trajectories(drives, tmp_path / "oracle.parquet")
    out, _ = oracle("stats", "--trajectories", "oracle.parquet", "--split", "test", "--out", "made")
    assert f"Composition of the oracle: 3 drives, test split ({len(rows):,} scenarios)" in out
    assert "36828" in out
    assert {path.name for path in (tmp_path / "made").iterdir()} == {
        f"oracle.{s}" for s in ("csv", "tex", "md", "png", "svg")
    }
    assert "all types,idm-e,2,66.666667,2," in (tmp_path / "made" / "oracle.csv").read_text()


def test_a_drive_that_does_not_replay_is_named(oracle: Command, tmp_path: Path, rows: list[ScenarioSpec]) -> None:
    """Exit code 1: the input is in order, what it says is not so."""
    scenario = rows[0].scenario_id
    write_trajectories([drive(scenario, "idm-e", 1)], tmp_path / "oracle.parquet")
    _, err = oracle("verify", "--trajectories", "oracle.parquet", "--split", "test", expect=1)
    assert err.startswith(f"error: {scenario}: idm-e, attempt 0: the replay differs from the recorded drive")


def test_drives_of_unknown_scenarios_are_refused(oracle: Command, tmp_path: Path) -> None:
    write_trajectories([drive("elsewhere-v0", "idm-e", 1)], tmp_path / "oracle.parquet")
    assert "scenario elsewhere-v0 is not in" in refused(
        oracle, "stats", "--trajectories", "oracle.parquet", "--split", "test"
    )


@pytest.mark.slow
def test_a_fine_tuning_without_drives_or_base_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    train = in_process("train", capsys)
    out = ("--out", str(tmp_path / "out"))
    missing = refused(train, "frames", "--trajectories", str(tmp_path / "none.parquet"), *out)
    assert "none.parquet" in missing
    (tmp_path / "empty").mkdir()
    base = refused(train, "plant2-ft", "--planner", "idm-e", "--base", str(tmp_path / "empty"), *out)
    assert "plant2.json" in base
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize("planner", ["ppo", "carl", "plant2-ft"])
def test_types_to_draw_more_often_are_checked_before_anything_starts(
    planner: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    told = refused(in_process("train", capsys), planner, "--more", "yeild", "--out", str(tmp_path / "out"))
    assert told.startswith("error: --more yeild: no such type or group (did you mean yield?): groups are")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_measure_refuses_what_is_not_there(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    train = in_process("train", capsys)
    assert "plant2-ft.json" in refused(train, "measure", str(tmp_path))
    assert "--stop-policy" in refused(
        train, "measure", "--planner", "plant2", "--stop-policy", "0.1", "5", "0.02", "0", "3"
    )


@pytest.mark.slow
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
