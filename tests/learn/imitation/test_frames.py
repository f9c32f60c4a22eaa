"""Training frames: what was seen, and what the driver did next."""

from __future__ import annotations

from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from tsbench.core.errors import InputError, SimulationError
from tsbench.episode.outcome import EpisodeResult
from tsbench.episode.runner import EpisodeRunner
from tsbench.learn.imitation.frames import (
    FRAME,
    DrivenPath,
    DriveResult,
    Imitated,
    PlannerDrive,
    Sampling,
    frames_of,
    observations,
)
from tsbench.learn.imitation.frames_store import FrameStore, ImitationSource, TrainingResources, make_chunk, plan_hash
from tsbench.learn.plant2 import tokens as at
from tsbench.learn.plant2.tokens import Tokeniser
from tsbench.planners.registry import resolve
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import Roads, SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import WorldSnapshot

SOURCE = ImitationSource(Sampling())


@pytest.fixture(scope="module")
def row() -> ScenarioSpec:
    return next(r for r in DataSet().table("test") if r.scenario_type == "yield" and r.variant == 3)


@pytest.fixture(scope="module")
def drive(row: ScenarioSpec, sim: Simulation) -> tuple[EpisodeResult, Roads]:
    loader = SceneLoader(DataSet())
    return EpisodeRunner(resolve("idm"), simulation=sim, loader=loader).run(row), loader.load(row)[1]


def frames(drive: tuple[EpisodeResult, Roads], sampling: Sampling) -> at.Records:
    result, roads = drive
    driven, tokeniser = DriveResult(result.facts, roads), Tokeniser(roads.view.map)
    teacher = Imitated(driven, sampling)
    return frames_of(driven, tokeniser, teacher, sampling, np.random.default_rng(1), FRAME)


def snapshots(places: np.ndarray, speeds: np.ndarray) -> list[WorldSnapshot]:
    made = [
        SimpleNamespace(ego=SimpleNamespace(x=x, y=y, speed=v))
        for (x, y), v in zip(places.tolist(), speeds.tolist(), strict=True)
    ]
    return cast("list[WorldSnapshot]", made)


def test_targets_are_the_driven_way_and_not_the_route() -> None:
    """Along x at 5 m/s, then to the left: the path bends where the driver did."""
    s = 0.5 * np.arange(101)
    places = np.column_stack((np.minimum(s, 10.0), np.maximum(s - 10.0, 0.0)))
    track = DrivenPath(snapshots(places, np.full(101, 5.0)))
    frame = np.zeros(1, dtype=FRAME)[0]
    track.targets(frame, 0, (0.0, 0.0, 0.0), 0.7)
    assert np.allclose(frame["path"][:10], [(k, 0.0) for k in range(1, 11)], atol=1e-5)
    assert np.allclose(frame["path"][10:], [(10.0, k) for k in range(1, 11)], atol=1e-5)
    assert np.allclose(frame["waypoints"], [(1.25 * k, 0.0) for k in range(1, 9)], atol=1e-5)
    assert frame["path_known"].all()
    assert frame["speed"] == 5.0
    track.targets(frame, 90, (10.0, 35.0, np.pi / 2), 0.7)
    assert frame["path_known"].sum() == 5
    assert frame["waypoints_known"].sum() == 4
    assert np.allclose(frame["path"][:5], [(k, 0.0) for k in range(1, 6)], atol=1e-5)


def test_the_copy_from_beside_has_the_same_targets_in_the_world(drive: tuple[EpisodeResult, Roads]) -> None:
    made = frames(drive, Sampling())
    own, beside = made[::2], made[1::2]
    assert len(own) == len(beside) > 20
    for name in ("speed", "path_known", "waypoints_known", "limits"):
        assert np.array_equal(own[name], beside[name])
    # A turn and a shift keep distances between points.
    steps = [np.diff(part["path"], axis=1) for part in (own, beside)]
    lengths = [np.hypot(step[..., 0], step[..., 1]) for step in steps]
    assert np.allclose(*lengths, atol=1e-4)
    moved = np.abs(own["route"][:, 0, 1] - beside["route"][:, 0, 1]) * at.POSITION_SCALE_M
    assert 0.2 < moved.mean() < 0.9
    assert moved.max() < 1.0 + 20.0 * np.sin(np.radians(5.0))


def test_frames_show_what_the_driver_saw(drive: tuple[EpisodeResult, Roads]) -> None:
    result, roads = drive
    made = frames(drive, Sampling())
    seen = list(observations(result.facts, roads))
    tokens = Tokeniser(roads.view.map).tokens(seen[5])
    for name in at.TOKENS.names or ():
        assert made[2][name].tobytes() == tokens[0][name].tobytes()


def test_forecast_follows_the_objects(drive: tuple[EpisodeResult, Roads]) -> None:
    made = frames(drive, Sampling())
    known = made["forecast_known"].astype(bool)
    assert known.any()
    assert not known[made["kinds"] == at.EMPTY].any()
    ahead = made["forecast"][..., 0]
    speed = made["objects"][..., 4] * at.SPEED_SCALE_MPS
    steady = known[..., 0] & (speed > 1.0)
    assert np.median(np.abs(ahead[..., 0] - speed)[steady]) < 1.5


def test_standing_is_thinned_out(drive: tuple[EpisodeResult, Roads]) -> None:
    places = np.column_stack((np.minimum(0.5 * np.arange(301), 50.0), np.zeros(301)))
    track = DrivenPath(snapshots(places, np.where(np.arange(301) < 100, 5.0, 0.0)))
    sampling = Sampling()
    kept = [k for k in range(0, 300, sampling.every) if track.kept(k, sampling)]
    assert sum(k < 100 for k in kept) == 20
    assert sum(k >= 100 for k in kept) <= 40 / sampling.standing + 1


def test_a_chunk_that_was_dropped_is_made_the_same_again(row: ScenarioSpec, tmp_path: Path) -> None:
    drives = [PlannerDrive(row, "idm")]
    for name in ("a.npy", "b.npy"):
        make_chunk(tmp_path / name, drives, SOURCE, (0, 0))
    assert (tmp_path / "a.npy").read_bytes() == (tmp_path / "b.npy").read_bytes()


def store(root: Path, row: ScenarioSpec, bound: int) -> tuple[FrameStore, Path]:
    """A store and its own folder."""
    drives = [PlannerDrive(row, "idm")] * 50
    made = FrameStore(TrainingResources(root, "cpu", 1, bound), drives, SOURCE, 0, lambda _: None)
    return made, root / "frames" / made.plan


def test_the_folder_keeps_to_its_bound(row: ScenarioSpec, tmp_path: Path) -> None:
    blank = tmp_path / "blank.npy"
    np.save(blank, np.zeros(4, dtype=FRAME))
    made, folder = store(tmp_path, row, 2 * blank.stat().st_size)
    for number in range(3):
        (folder / f"chunk-{number:05d}.npy").write_bytes(blank.read_bytes())
    assert len(made.load([2])) == 4
    assert sorted(p.name for p in folder.glob("*.npy")) == ["chunk-00001.npy", "chunk-00002.npy"]


def test_another_plan_has_another_folder(row: ScenarioSpec) -> None:
    drives = [PlannerDrive(row, "idm")]
    plans = {
        plan_hash(drives, SOURCE, 0), plan_hash(drives, SOURCE, 1), plan_hash(drives * 2, SOURCE, 0),
        plan_hash([PlannerDrive(row, "idm-s1")], SOURCE, 0), plan_hash(drives, ImitationSource(Sampling(every=4)), 0),
        plan_hash([PlannerDrive(replace(row, additional_sha256="0"), "idm")], SOURCE, 0),
    }  # fmt: skip
    assert len(plans) == 6


def test_foreign_frames_are_refused(row: ScenarioSpec, tmp_path: Path) -> None:
    made, folder = store(tmp_path, row, 10**9)
    np.save(folder / "chunk-00000.npy", np.zeros(4))
    with pytest.raises(InputError, match="frames of another tsbench"):
        made.load([0])
    (folder / "chunk-00000.npy").write_bytes(b"no")
    with pytest.raises(InputError, match="no frames"):
        made.load([0])


class Died(Future[None]):
    """What a pool says of a job whose process is gone."""

    def result(self, timeout: float | None = None) -> None:
        raise BrokenProcessPool


def test_a_process_that_keeps_dying_is_told_in_one_line(
    row: ScenarioSpec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried = []

    def submit(self: ProcessPoolExecutor, *job: object) -> Future[None]:
        tried.append(job)
        future = Died()
        future.set_result(None)
        return future

    monkeypatch.setattr(ProcessPoolExecutor, "submit", submit)
    made, _ = store(tmp_path, row, 10**9)
    with pytest.raises(SimulationError, match="died 3 times"):
        made.load([0])
    assert len(tried) == 3
