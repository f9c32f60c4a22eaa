"""Drives kept by their commands: stored, read and replayed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from learned_scenes import recorded_drive

from tsbench.core.errors import InputError, SimulationError
from tsbench.episode.outcome import EpisodeResult
from tsbench.learn.oracle.collect import experts
from tsbench.learn.oracle.trajectories import (
    STEPS,
    Recorded,
    Replayer,
    control_of,
    quantise,
    steps_of,
    stream_trajectories,
    write_trajectories,
)
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.ego import MAX_ACCEL_MPS2, MAX_DECEL_MPS2, MAX_STEER_RAD, Motion, advance
from tsbench.sim.sumo import Simulation

Driven = tuple[EpisodeResult, Recorded]


@pytest.fixture(scope="module")
def row() -> ScenarioSpec:
    """A lane for buses ahead: the expert changes lanes early and says so."""
    return next(r for r in DataSet().table("train") if r.scenario_type == "bus_lane")


@pytest.fixture(scope="module")
def drive(row: ScenarioSpec, sim: Simulation) -> Driven:
    return recorded_drive("idm-s4-e", row, sim, SceneLoader(DataSet()))


def test_a_replay_is_the_drive_bit_for_bit(drive: Driven, row: ScenarioSpec, sim: Simulation, tmp_path: Path) -> None:
    """From disk; what the expert announced is announced again, so others give way at the same ticks."""
    result, recorded = drive
    write_trajectories([recorded], tmp_path / "drives.parquet")
    (read,) = stream_trajectories(tmp_path / "drives.parquet")
    facts = Replayer(sim, SceneLoader(DataSet())).replay(read, row)
    assert read.intents
    assert len(facts.snapshots) == len(result.facts.snapshots) > 100
    for now, before in zip(facts.snapshots, result.facts.snapshots, strict=True):
        assert now.ego == before.ego
        assert now.actors.pose.tobytes() == before.actors.pose.tobytes()


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"others": "0" * 16}, "other road users were elsewhere"),
        ({"ego": "0" * 16}, "the ego was elsewhere"),
        ({"commands": np.zeros((20, 2), dtype=np.int16)}, "the recorded drive ended after 20 ticks"),
        ({"commands": np.full((400, 2), [1500, -4000], dtype=np.int16)}, r"it ended \(\w+\) after \d+ ticks of 400"),
        ({"scenario_id": "elsewhere-v0"}, "it was asked to drive"),
    ],
)
def test_another_drive_is_no_replay(
    drive: Driven, row: ScenarioSpec, sim: Simulation, change: dict[str, object], told: str
) -> None:
    """The error says which drive, and in what it differs."""
    other = replace(drive[1], **change)  # type: ignore[arg-type]
    with pytest.raises(SimulationError, match=rf"{other.scenario_id}: idm-s4-e, attempt 0: .*{told}"):
        Replayer(sim, SceneLoader(DataSet())).replay(other, row)


def test_the_table_gives_back_what_was_written(drive: Driven, tmp_path: Path) -> None:
    first = drive[1]
    second = replace(first, rank=2, planner="idm-e", attempt=3, part="validation", intents=(), comfort=0.25)
    third = replace(first, scenario_id="a", commands=first.commands[:7], quality=None)
    paths = [tmp_path / name for name in ("one.parquet", "other.parquet")]
    write_trajectories([second, first, third], paths[0])
    write_trajectories([third, second, first], paths[1])
    assert paths[0].read_bytes() == paths[1].read_bytes()
    read = list(stream_trajectories(paths[0]))
    for back, given_ in zip(read, (third, first, second), strict=True):
        assert back.commands.tobytes() == given_.commands.tobytes()
        for name in Recorded.__slots__:
            if name != "commands":
                assert getattr(back, name) == getattr(given_, name)


def test_a_table_without_drives(tmp_path: Path) -> None:
    write_trajectories([], tmp_path / "none.parquet")
    assert list(stream_trajectories(tmp_path / "none.parquet")) == []
    with pytest.raises(InputError, match=r"is missing|schema version"):
        list(stream_trajectories(DataSet().table_path("train")))


@given(st.floats(-1e6, 1e6), st.floats(-1e3, 1e3))
def test_rounding_keeps_within_limits_and_is_done_once(acceleration: float, steering: float) -> None:
    steps = quantise(acceleration, steering)
    control = control_of(*steps, ())
    assert quantise(control.acceleration, control.steering) == steps
    assert tuple(steps_of(np.array([[control.acceleration, control.steering]]))[0]) == steps
    assert -MAX_DECEL_MPS2 <= control.acceleration <= MAX_ACCEL_MPS2
    assert abs(control.steering) <= MAX_STEER_RAD
    start = Motion(0.0, 0.0, 0.0, 8.0)
    asked, driven = (
        advance(start, a, s) for a, s in ((acceleration, steering), (control.acceleration, control.steering))
    )
    assert abs(asked.acceleration - driven.acceleration) <= 0.51 / STEPS[0]
    assert abs(asked.steering - driven.steering) <= 0.51 / STEPS[1]


TABLE = Path(__file__).parent / "data" / "oracle.parquet"
DRIVES = list(stream_trajectories(TABLE))


@pytest.fixture(scope="module")
def replayer(sim: Simulation) -> Replayer:
    return Replayer(sim, SceneLoader(DataSet()))


def test_all_types_and_experts_are_in_it(rows: list[ScenarioSpec]) -> None:
    assert {d.scenario_id.partition("-")[0] for d in DRIVES} == {row.pair_type for row in rows}
    assert {d.planner for d in DRIVES} == set(experts())


@pytest.mark.parametrize("recorded", DRIVES, ids=lambda d: f"{d.scenario_id}-{d.planner}")
def test_a_drive_is_replayed_as_it_was_recorded(
    recorded: Recorded, rows: list[ScenarioSpec], replayer: Replayer
) -> None:
    """Else the replay is refused, and says what differs."""
    row = next(row for row in rows if row.scenario_id == recorded.scenario_id)
    facts = replayer.replay(recorded, row)
    assert facts.verdicts.compliant
    assert facts.outcome == "arrived"
