"""Training of `plant2`: losses, the choice of episodes, and going on after a break."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from training_helpers import store_frames, straight_frames

from tsbench.core.errors import InputError
from tsbench.learn.imitation import trainer
from tsbench.learn.imitation.frames import FRAME, PlannerDrive
from tsbench.learn.imitation.frames_store import ImitationSource, TrainingResources, plan_hash
from tsbench.learn.imitation.recipe import (
    ImitationRecipe,
    Skill,
    drives_of,
    in_turn,
    kept_for_validation,
    validation_rows,
)
from tsbench.learn.imitation.task import batches_of, imitation
from tsbench.learn.imitation.trainer import losses, rate_at, total, train, trimmed, two_hot
from tsbench.learn.plant2 import tokens as at
from tsbench.learn.plant2.plant2_network import Plant2Network
from tsbench.learn.training_folder import read_rows
from tsbench.planners.weights import load_weights
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import HALVES, ScenarioSpec

pytestmark = pytest.mark.slow

SKILLS = [Skill(4, a, 0.0, 0.0, 1.0 - a, 0.0, 0.5) for a in (0.5, 0.9, 0.7)]


@pytest.fixture(scope="module")
def rows() -> list[ScenarioSpec]:
    return DataSet().table("test")


def made_up(count: int, seed: int = 0) -> at.Records:
    """Frames of straight driving at the limit."""
    frames = straight_frames(count, FRAME, seed)
    frames["limits"] = np.random.default_rng(seed).uniform(0.5, 1.5, (count, 1))
    frames["speed"] = frames["limits"][:, 0] * at.SPEED_SCALE_MPS
    return frames


def test_two_hot_means_the_speed_and_tells_crawling_from_standing() -> None:
    speed = torch.tensor([0.0, 0.4, 1.0, 3.0, 9.5, 18.0, 22.0])
    target = two_hot(speed)
    assert torch.allclose(target.sum(1), torch.ones(7))
    assert torch.allclose(target @ torch.tensor(at.SPEEDS), speed.clamp(max=18.0), atol=1e-5)
    assert (target > 0).sum(1).max() <= 2
    assert target[0, 0] == 1.0
    assert target[1, 1] == pytest.approx(0.4)


def test_unknown_targets_do_not_count() -> None:
    frames = made_up(8)
    frames["path_known"][:, 10:] = 0
    torch.manual_seed(0)
    net = Plant2Network("mini").eval()
    batch = trimmed(frames)
    before = losses(net(batch), batch)
    frames["path"][:, 10:] = 99.0
    changed = trimmed(frames)
    after = losses(net(changed), changed)
    assert all(torch.equal(before[name], after[name]) for name in before)
    assert total(before).item() > 0.0


def test_each_frame_is_in_one_batch_at_most_and_neighbours_are_alike() -> None:
    frames = made_up(1000)
    batches = batches_of(frames, np.random.default_rng(0).permutation(1000), 64)
    rows = np.concatenate(batches)
    assert len(rows) == len(set(rows.tolist())) == 15 * 64
    spread = [int(np.ptp(np.count_nonzero(frames["kinds"][b], axis=1))) for b in batches]
    assert np.mean(spread) < 2.0


def test_rate_rises_then_falls_to_nothing() -> None:
    recipe = ImitationRecipe()
    rates = [rate_at(share, recipe) for share in np.linspace(0.0, 1.0, 101)]
    assert max(rates) == pytest.approx(recipe.rate, rel=0.01)
    assert rates[0] < 0.02 * recipe.rate
    assert rates[-1] < 1e-9


def test_validation_maps_are_not_trained_on(rows: list[ScenarioSpec]) -> None:
    recipe = ImitationRecipe(episodes=600, validation=40)
    drives = drives_of(rows, recipe)
    chosen = validation_rows(rows, 40, 0)
    assert len(drives) == 600
    assert len({d.spec.scenario_id for d in drives}) == 600
    assert not {d.spec.map_id for d in drives} & {r.map_id for r in chosen}
    assert all(kept_for_validation(r) for r in chosen)
    assert drives_of(rows[::-1], recipe) == drives


def test_both_halves_of_a_pair_are_drawn_together(rows: list[ScenarioSpec]) -> None:
    """A half's own type is its plate's: by that a pair would be torn apart."""
    recipe = ImitationRecipe(episodes=600, drivers=("idm", "idm-s3"))
    drives = drives_of(rows, recipe)
    pairs: dict[str, list[PlannerDrive]] = {}
    for drive in drives:
        pairs.setdefault(drive.spec.pair_name, []).append(drive)
    types = [pair[0].spec.pair_type for pair in pairs.values()]
    assert max(types.count(t) for t in set(types)) - min(types.count(t) for t in set(types)) <= 1
    *whole, _ = [pair for pair in pairs.values() if pair[0].spec.pair_id]
    assert len(whole) > 200
    assert any(signed.spec.scenario_type != contrast.spec.scenario_type for signed, contrast in whole)
    for signed, contrast in whole:
        assert (signed.spec.half, contrast.spec.half) == HALVES
        assert signed.driver == contrast.driver
        assert drives.index(contrast) == drives.index(signed) + 1
    assert [pair[0].driver for pair in pairs.values()][:3] == ["idm", "idm-s3", "idm"]


def test_a_type_that_is_asked_for_more_of_has_three_pairs_a_turn(rows: list[ScenarioSpec]) -> None:
    drawn = in_turn(rows, 8, 0, "lessons", more=("bike_lane",))
    assert [row.pair_type for row in drawn] == ["bike_lane"] * 6 + ["bike_lane_road", "blocked_road"]


def prepared(
    out: Path, monkeypatch: pytest.MonkeyPatch, rows: list[ScenarioSpec]
) -> tuple[ImitationRecipe, TrainingResources]:
    """A training of three epochs of two windows whose frames are there already, and whose skills are told."""
    monkeypatch.setattr(trainer, "_WINDOW_CHUNKS", 1)
    told = iter(SKILLS)
    monkeypatch.setattr(trainer, "measure", lambda *_: next(told))
    recipe = ImitationRecipe(episodes=40, epochs=3, batch=16, validation=4)
    plan = plan_hash(drives_of(rows, recipe), ImitationSource(recipe.sampling), recipe.seed)
    place = TrainingResources(out, "cpu", 1, 10**9)
    return recipe, store_frames(place, plan, [made_up(64, number) for number in range(2)])


def same(ours: Path, theirs: Path) -> None:
    """The same weights and the same curve."""
    mine, others = load_weights("plant2", ours), load_weights("plant2", theirs)
    assert all(np.array_equal(mine[name], others[name]) for name in others)
    first, second = (read_rows(at / "curve.jsonl") for at in (ours, theirs))
    assert [{**row, "seconds": 0} for row in first] == [{**row, "seconds": 0} for row in second]


def breaking(subject: Callable[..., Any], call: int) -> Callable[..., Any]:
    """The function, interrupted when it is called for the `call`-th time."""
    calls: list[tuple[Any, ...]] = []

    def breaks(*arguments: Any) -> Any:
        calls.append(arguments)
        if len(calls) == call:
            raise KeyboardInterrupt
        return subject(*arguments)

    return breaks


def test_it_goes_on_within_a_window_and_after_a_broken_validation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rows: list[ScenarioSpec]
) -> None:
    recipe, place = prepared(tmp_path / "whole", monkeypatch, rows)
    whole = train(imitation(recipe, rows), place, lambda _: None)
    assert (whole.training["epoch"], whole.training["validation_skill"]["arrived"]) == (2, 0.9)

    recipe, place = prepared(tmp_path / "broken", monkeypatch, rows)
    monkeypatch.setattr(trainer, "_KEEP_EVERY_S", 0.0)
    said: list[str] = []
    for name, call in (("losses", 7), ("measure", 2)):
        with monkeypatch.context() as patch:
            patch.setattr(trainer, name, breaking(getattr(trainer, name), call))
            with pytest.raises(KeyboardInterrupt):
                train(imitation(recipe, rows), place, said.append)
    train(imitation(recipe, rows), place, said.append)
    assert [line.split()[3] for line in said if "continues in epoch" in line] == ["1", "2"]
    same(tmp_path / "broken", tmp_path / "whole")
    # A line a batch here, a minute in use.
    assert sum("batch" in line for line in said) == 24


def test_it_learns_and_another_training_is_not_continued(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rows: list[ScenarioSpec]
) -> None:
    recipe, place = prepared(tmp_path, monkeypatch, rows)
    recipe, said = replace(recipe, rate=2e-3), []
    train(imitation(recipe, rows), place, said.append)
    speeds = [float(line.split("speed ")[1].split()[0]) for line in said if "window" in line]
    assert speeds[-1] < 0.8 * speeds[0]
    with pytest.raises(InputError, match="of a training with batch 16, not 32"):
        train(imitation(replace(recipe, batch=32), rows), place, lambda _: None)
    with pytest.raises(InputError, match="of a training with plan"):
        train(imitation(recipe, rows[: len(rows) // 2]), place, lambda _: None)
    (tmp_path / "checkpoint.safetensors").write_bytes(b"no")
    with pytest.raises(InputError, match="no checkpoint of this training"):
        train(imitation(recipe, rows), place, lambda _: None)
