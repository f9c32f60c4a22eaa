"""Drives kept by their commands: stored, read and replayed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsbench.core.errors import InputError, SimulationError
from tsbench.episode.outcome import EpisodeResult
from tsbench.episode.runner import EpisodeRunner
from tsbench.learn.oracle.trajectories import (
    STEPS,
    QuantisedPlanner,
    Recorded,
    Replayer,
    control_of,
    fingerprints,
    quantise,
    retry_seed,
    steps_of,
    stream_trajectories,
    write_trajectories,
)
from tsbench.planners.registry import resolve
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.ego import MAX_ACCEL_MPS2, MAX_DECEL_MPS2, MAX_STEER_RAD, Motion, advance
from tsbench.sim.sumo import Simulation


class DriveResult:
    """An expert that announces its way, with rounded commands."""

    def __init__(self, simulation: Simulation, loader: SceneLoader) -> None:
        expert = resolve("idm-s4-e")
        self.rounded = QuantisedPlanner(expert.factory)
        rounded = replace(expert, factory=lambda: self.rounded)
        self.run = EpisodeRunner(rounded, simulation=simulation, loader=loader).run


@pytest.fixture(scope="module")
def row() -> ScenarioSpec:
    """A lane for buses ahead: the expert changes lanes early and says so."""
    return next(r for r in DataSet.in_use().table("train") if r.scenario_type == "bus_lane")


@pytest.fixture(scope="module")
def sumo() -> Iterator[Simulation]:
    simulation = Simulation()
    yield simulation
    simulation.close()


@pytest.fixture(scope="module")
def drive(row: ScenarioSpec, sumo: Simulation) -> tuple[EpisodeResult, Recorded]:
    runner = DriveResult(sumo, SceneLoader(DataSet.in_use()))
    result = runner.run(row)
    assert result.facts is not None, result.detail
    ego, others = fingerprints(result.facts.snapshots)
    return result, Recorded(
        scenario_id=row.scenario_id, planner="idm-s4-e", attempt=0, part="train", rank=1, quality=0.5, comfort=None,
        commands=steps_of(result.commands), intents=tuple(runner.rounded.intents), ego=ego, others=others,
    )  # fmt: skip


def test_a_replay_is_the_drive_bit_for_bit(
    drive: tuple[EpisodeResult, Recorded], row: ScenarioSpec, sumo: Simulation, tmp_path: Path
) -> None:
    """From disk; what the expert announced is announced again, so others give way at the same ticks."""
    result, recorded = drive
    write_trajectories([recorded], tmp_path / "drives.parquet")
    (read,) = stream_trajectories(tmp_path / "drives.parquet")
    facts = Replayer(sumo, SceneLoader(DataSet.in_use())).replay(read, row)
    assert read.intents
    assert result.facts is not None
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
    drive: tuple[EpisodeResult, Recorded], row: ScenarioSpec, sumo: Simulation, change: dict[str, object], told: str
) -> None:
    """The error says which drive, and in what it differs."""
    other = replace(drive[1], **change)  # type: ignore[arg-type]
    with pytest.raises(SimulationError, match=rf"{other.scenario_id}: idm-s4-e, attempt 0: .*{told}"):
        Replayer(sumo, SceneLoader(DataSet.in_use())).replay(other, row)


def test_the_table_gives_back_what_was_written(drive: tuple[EpisodeResult, Recorded], tmp_path: Path) -> None:
    """Whatever the order of writing: the same bytes, sorted by scenario and rank."""
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
    """Nothing found is a table too; another table is not."""
    write_trajectories([], tmp_path / "none.parquet")
    assert list(stream_trajectories(tmp_path / "none.parquet")) == []
    with pytest.raises(InputError, match=r"is missing|schema version"):
        list(stream_trajectories(DataSet.in_use().table_path("train")))


@given(st.floats(-1e6, 1e6), st.floats(-1e3, 1e3))
def test_rounding_keeps_within_limits_and_is_done_once(acceleration: float, steering: float) -> None:
    """A rounded command rounds to itself, fits its type, and drives within half a step of the asked one."""
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


def test_retries_draw_other_drivers() -> None:
    """The first attempt is the episode as it stands; each further one has a seed of its own."""
    assert retry_seed(7, 0) == 7
    assert len({retry_seed(seed, attempt) for seed in (7, 8) for attempt in range(4)}) == 8
