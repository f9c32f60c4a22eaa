"""Fine-tuning of `plant2-ft`: batches, rates, the choice of drives, and a training that is broken off."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from training_helpers import fresh_blind, fresh_tuned, fresh_weights, store_frames, straight_frames

from tsbench.core.errors import InputError
from tsbench.learn.imitation import trainer
from tsbench.learn.imitation.drives_report import report
from tsbench.learn.imitation.frames import PlannerDrive
from tsbench.learn.imitation.frames_store import TrainingResources, plan_hash
from tsbench.learn.imitation.recipe import FineTuning, Skill, finetune_drives, kept_for_validation
from tsbench.learn.imitation.targets import FAMILIES, SIGN_FRAME, FinetuneSource, RecordedDrive, TakeoverDrive
from tsbench.learn.imitation.task import ImitationTask, beginning, capped_batches, fine_tuning, quotas, share_of
from tsbench.learn.imitation.trainer import train
from tsbench.learn.oracle.trajectories import Recorded, write_trajectories
from tsbench.learn.plant2 import tokens as at
from tsbench.learn.plant2.plant2_network import Plant2Network
from tsbench.learn.plant2.plant2_planner import Plant2Blind, Plant2Ft
from tsbench.learn.plant2.sign_tokens import vocabulary_of
from tsbench.planners.weights import load_weights
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import HALVES, ScenarioSpec

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> None:
    """These products are too small to share."""
    torch.set_num_threads(1)


@pytest.fixture(scope="module")
def rows() -> list[ScenarioSpec]:
    return DataSet().table("test")


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return fresh_weights(tmp_path_factory.mktemp("base"), "plant2", Plant2Network)


def made_up(count: int, seed: int = 0) -> at.Records:
    """Frames of straight driving; who sees 4.1.1 wishes 2 m/s, the others 11."""
    rng, frames = np.random.default_rng(seed), straight_frames(count, SIGN_FRAME, seed)
    frames["family"] = rng.integers(0, len(FAMILIES), count)
    frames["type"] = rng.integers(0, 29, count)
    seen = frames["family"] % 2 == 0
    frames["sign_classes"][seen, 0] = 12
    frames["held_classes"][seen, 0] = 12
    frames["speed"] = np.where(seen, 2.0, 11.0)
    return frames


def test_no_family_has_more_than_its_share_of_a_batch() -> None:
    frames = made_up(3000)
    frames["family"][:1500] = FAMILIES.index("manoeuvre")
    batches = capped_batches(frames, np.random.default_rng(0).permutation(3000), 128, 0.25)
    assert len(batches) > 10
    for rows in batches:
        assert len(rows) == 128
        assert np.bincount(frames["family"][rows]).max() <= 32
    every = np.concatenate(batches)
    assert len(every) == len(set(every.tolist()))
    spread = [int(np.ptp(np.count_nonzero(frames["kinds"][b], axis=1))) for b in batches]
    assert np.mean(spread) < 6.0


def test_quotas_fill_the_batch_as_there_are_frames() -> None:
    assert quotas(np.array([100, 0, 300, 0, 0, 0]), 8, 0.25).tolist() == [4, 0, 4, 0, 0, 0]
    even = quotas(np.array([50, 50, 50, 50, 50, 50]), 120, 0.25)
    assert even.tolist() == [20] * 6
    some = quotas(np.array([10, 20, 30, 40, 50, 5000]), 128, 0.25)
    assert some.sum() == 128
    assert some.max() == some[5] == 32
    assert capped_batches(made_up(3), np.arange(3), 128, 0.25) == []


def test_rates_fall_towards_the_inputs_and_are_higher_for_what_is_new() -> None:
    net, recipe = fresh_tuned("mini"), FineTuning()
    shares = {name: share_of(name, 4, recipe) for name, _ in net.named_parameters()}
    assert shares["signs.weight"] == shares["speed_token"] == shares["ego_speed_head.bias"] == 5.0
    assert shares["path_head.first.weight"] == 1.0
    assert shares["encoder.layers.3.linear1.weight"] == pytest.approx(0.8)
    assert shares["encoder.layers.0.linear1.weight"] == pytest.approx(0.8**4)
    assert shares["queries"] == shares["objects.weight"] == pytest.approx(0.8**5)


def recorded(row: ScenarioSpec, rank: int, part: str) -> Recorded:
    return Recorded(
        scenario_id=row.scenario_id, planner="idm-e", attempt=0, part=part, rank=rank, quality=None, comfort=None,
        commands=np.zeros((4, 2), dtype=np.int16), intents=(), ego=f"{rank:016x}", others="0" * 16,
    )  # fmt: skip


def test_drives_are_of_no_map_that_checkpoints_are_chosen_on(
    rows: list[ScenarioSpec], base: Path, tmp_path: Path
) -> None:
    driven = finetune_drives(rows, FineTuning(base=base, drivers=("idm-e", "idm-s4-e"), drives=100))
    assert not any(kept_for_validation(drive.spec) for drive in driven)
    turns = {drive.spec.pair_name: drive.driver for drive in driven if isinstance(drive, PlannerDrive)}
    assert list(turns.values())[:3] == ["idm-e", "idm-s4-e", "idm-e"]
    assert {drive.spec.half for drive in driven} == set(HALVES)

    path = tmp_path / "oracle.parquet"
    kept = next(row for row in rows if kept_for_validation(row))
    one, two, *_ = [row for row in rows if not kept_for_validation(row)]
    table = [
        recorded(one, 1, "train"),
        recorded(one, 2, "train"),
        recorded(two, 1, "validation"),
        recorded(kept, 1, "train"),
    ]
    write_trajectories(table, path)
    recipe = FineTuning(base=base, trajectories=path)
    found = finetune_drives(rows, recipe)
    assert [d.recorded.rank for d in found if isinstance(d, RecordedDrive)] == [1, 2]
    assert recipe.facts()["trajectories"] is not None
    with pytest.raises(InputError, match="no drives of the train split"):
        finetune_drives([two], recipe)


def test_a_share_of_drives_is_begun_by_the_student(rows: list[ScenarioSpec], base: Path, tmp_path: Path) -> None:
    fresh_weights(tmp_path, "plant2-ft", fresh_tuned)
    recipe = FineTuning(base=base, drivers=("idm-e",), drives=200, student=tmp_path, takeover=0.3)
    drives = finetune_drives(rows, recipe)
    taken = [drive for drive in drives if isinstance(drive, TakeoverDrive)]
    assert 35 < len(taken) < 85
    assert len({drive.tick for drive in taken}) > 20
    assert finetune_drives(rows, recipe) == drives
    assert len({drive.spec.scenario_type for drive in taken}) > 20


def prepared(
    out: Path, monkeypatch: pytest.MonkeyPatch, rows: list[ScenarioSpec], base: Path
) -> tuple[ImitationTask, TrainingResources]:
    """A training of three epochs of two windows whose frames are there already, and whose skills are told.

    The second is the best: the third has as much SCD and complies less.
    """
    monkeypatch.setattr(trainer, "_WINDOW_CHUNKS", 1)
    skills = ((0.25, 0.5), (0.75, 1.0), (0.75, 0.75))
    told = iter([Skill(4, 0.9, 0.0, 0.0, 0.1, scd, compliant) for scd, compliant in skills])
    monkeypatch.setattr(trainer, "measure", lambda *_: next(told))
    recipe = FineTuning(base=base, drivers=("idm-e",), drives=40, epochs=3, batch=16, validation=4, rate=1e-3)
    source = FinetuneSource(recipe.sampling, recipe.vocabulary())
    plan = plan_hash(finetune_drives(rows, recipe), source, recipe.seed)
    place = store_frames(TrainingResources(out, "cpu", 1, 10**9), plan, [made_up(96, number) for number in range(2)])
    return fine_tuning(recipe, rows), place


def test_a_training_learns_and_what_it_made_can_be_trained_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rows: list[ScenarioSpec], base: Path
) -> None:
    said: list[str] = []
    task, place = prepared(tmp_path, monkeypatch, rows, base)
    whole = train(task, place, said.append)
    assert whole.training["epoch"] == 2
    assert whole.training["validation_skill"]["scd"] == 0.75
    speeds = [float(line.split("speed ")[1].split()[0]) for line in said if "window" in line]
    assert speeds[-1] < 0.8 * speeds[0]

    Plant2Ft(folder=tmp_path)
    again = FineTuning(base=tmp_path, drivers=("idm-e",), drives=1)
    ours = torch.from_numpy(load_weights("plant2-ft", tmp_path)["signs.weight"])
    assert torch.equal(beginning(again, again.vocabulary()).state_dict()["signs.weight"], ours)

    # One whose signs are masked is of another network, and refuses this one's checkpoint.
    recipe = replace(task.recipe, mask_signs=True)
    masked = fine_tuning(recipe, rows)
    assert (task.name, masked.name) == ("plant2-ft", "plant2-blind")
    with pytest.raises(InputError, match="with mask_signs False, not True: take another --out"):
        train(masked, place, lambda _: None)
    assert recipe.facts()["mask_signs"] is True


def test_a_masked_student_is_blind(rows: list[ScenarioSpec], base: Path, tmp_path: Path) -> None:
    recipe = FineTuning(base=base, drivers=("idm-e",), drives=20, student=tmp_path, takeover=1.0, mask_signs=True)
    fresh_weights(tmp_path, "plant2-ft", fresh_tuned)
    with pytest.raises(InputError, match=r"plant2-blind\.json"):
        finetune_drives(rows, recipe)
    fresh_weights(tmp_path, "plant2-blind", fresh_blind)
    drives = finetune_drives(rows, recipe)
    assert {drive.planner for drive in drives if isinstance(drive, TakeoverDrive)} == {Plant2Blind}
    # Who trains on keeps the words of the same network, not those of the reader beside it.
    again = replace(recipe, base=tmp_path)
    assert again.vocabulary() == vocabulary_of(tmp_path, "plant2-blind") != vocabulary_of(tmp_path)


def test_frames_are_told_and_shown(rows: list[ScenarioSpec], base: Path, tmp_path: Path) -> None:
    recipe = FineTuning(base=base, drivers=("idm-e",), drives=20)
    drives = finetune_drives(rows, recipe)
    folder = tmp_path / "frames" / plan_hash(drives, FinetuneSource(recipe.sampling, recipe.vocabulary()), recipe.seed)
    folder.mkdir(parents=True)
    frames = made_up(200)
    frames["type"] %= 6
    np.save(folder / "chunk-00000.npy", frames)
    paths = report(drives, recipe, TrainingResources(tmp_path, "cpu", 1, 10**9), lambda _: None)
    names = ["frames.md", "frames.png", "frames-priority.png"]
    assert [path.name for path in paths] == names
    assert all(path.stat().st_size > 0 for path in paths)
    assert "| all | | | 20 | 200 |" in paths[0].read_text()
    np.save(folder / "chunk-00000.npy", made_up(0))
    with pytest.raises(InputError, match="no frames to look at"):
        report(drives, recipe, TrainingResources(tmp_path, "cpu", 1, 10**9), lambda _: None)


def test_another_base_is_another_training(base: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        FineTuning(base=tmp_path).facts()
    facts = FineTuning(base=base).facts()
    assert facts["size"] == "mini"
    assert replace(FineTuning(base=base), epochs=2).facts()["base"] == facts["base"]
