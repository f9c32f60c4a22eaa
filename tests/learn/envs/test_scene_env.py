"""`scene`, the terms in `info`, options of `reset`, and the ids per group."""

from __future__ import annotations

from collections.abc import Mapping
from typing import get_args

import gymnasium
import numpy as np
import pytest

from tsbench.core.errors import InputError
from tsbench.learn.envs import GROUPS
from tsbench.learn.envs.drive_env import DriveEnv
from tsbench.learn.envs.reward import RewardSpec
from tsbench.learn.envs.seen_tables import LANE, PLATE, POINTS, SceneSeen
from tsbench.signs.model import Group

FULL = np.array([1.0, 0.0], dtype=np.float32)


def fast(reward: object = None) -> tuple[list[float], list[dict[str, object]]]:
    env = DriveEnv(split="dev", types="speed_limit", half="signed", reward=reward)  # type: ignore[arg-type]
    env.reset(options={"scenario": min(env._by_id)})
    rewards, infos, over = [], [], False
    while not over:
        _, earned, terminated, truncated, info = env.step(FULL)
        rewards.append(earned)
        infos.append(info)
        over = terminated or truncated
    env.close()
    return rewards, infos


def test_plates_and_ways_are_told_and_masked_plates_are_not() -> None:
    seen = {}
    for mask in (False, True):
        made = DriveEnv(split="dev", types="speed", observation="scene", mask_signs=mask)
        seen[mask] = made.reset(options={"scenario": min(made._by_id)})[0]
        made.close()
    shown, hidden = seen[False], seen[True]
    there = shown["plates_mask"] > 0
    assert there.any()
    assert (shown["plates"][there, 4 + len(PLATE) :].sum(axis=1) == 1.0).all()
    assert not hidden["plates"][:, 4:-1].any()
    assert (hidden["plates"][there, -1] == 1.0).all()
    near = shown["lanes"][shown["lanes_mask"] > 0]
    route = near[:, 2 * POINTS + LANE.index("on_route")] > 0
    assert route.any()
    assert (near[route, 2 * POINTS + LANE.index("leads")] == 1.0).all()


def test_plates_are_the_scene_without_its_lanes() -> None:
    seen = {}
    for kind in ("scene", "plates"):
        made = DriveEnv(split="dev", types="yield", observation=kind)
        seen[kind] = made.reset(options={"scenario": min(made._by_id)})[0]
        assert made.observation_space.contains(seen[kind])
        made.close()
    scene, plates = seen["scene"], seen["plates"]
    assert scene.keys() - plates.keys() == {"lanes", "lanes_mask"}
    assert all(np.array_equal(plates[name], scene[name]) for name in plates)


def test_violations_are_told_and_weigh_only_when_asked() -> None:
    plain, infos = fast()
    assert infos[-1]["violations"]
    assert infos[-1]["engaged"]
    priced, _ = fast(RewardSpec(violation=-2.0))
    count = len(infos[-1]["violations"])  # type: ignore[arg-type]
    assert sum(priced) == pytest.approx(sum(plain) - 2.0 * count)

    def own(terms: Mapping[str, float]) -> float:
        return terms["violation"]

    assert sum(fast(own)[0]) == -count


def test_options_narrow_the_draw() -> None:
    env = DriveEnv(split="dev")
    for half in ("signed", "contrast"):
        info = env.reset(options={"type": "priority", "half": half})[1]
        assert info["half"] == half
    for wrong, word in (({"half": "third"}, "third"), ({"kind": "yield"}, "kind"), ({"type": "no"}, "no")):
        with pytest.raises(InputError, match=word):
            env.reset(options=wrong)
    env.close()


def test_groups_have_ids() -> None:
    assert sorted(GROUPS.values()) == sorted(get_args(Group))
    for name, group in GROUPS.items():
        made = gymnasium.make(name, split="dev")
        rows = made.unwrapped._rows  # type: ignore[attr-defined]
        assert {row.group for row in rows if row.half == "signed"} == {group}
        assert made.observation_space == SceneSeen().space
        assert made.action_space.shape == (3,)
        before = gymnasium.make(gymnasium.spec(name.replace("v1", "v0")), split="dev")
        assert (before.observation_space.shape, before.action_space.shape) == ((275,), (2,))


def test_the_default_of_make_vec_is_refused_with_the_way_out() -> None:
    envs = gymnasium.make_vec("tsbench/Speed-v1", num_envs=2, vectorization_mode="sync", split="dev")
    envs.reset(seed=1)
    with pytest.raises(gymnasium.error.ResetNeeded, match='vectorization_mode="async"'):
        envs.step(np.zeros((2, 3), dtype=np.float32))
    envs.close()
