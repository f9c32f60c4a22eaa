"""`tsbench/Drive-v1` and `-v0`: the checkers' contract, and the same driving as `tsbench run`."""

from __future__ import annotations

import copy
import math
import pickle
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from command_line import one_line
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env

from tsbench.core.errors import InputError
from tsbench.episode.runner import EpisodeRunner
from tsbench.learn.envs import DRIVE, DRIVE_V0, MAX_STEPS
from tsbench.learn.envs.drive_env import Curriculum, DriveEnv
from tsbench.learn.rl.actions import aim
from tsbench.planners.base import Control
from tsbench.planners.observation import Observation
from tsbench.planners.registry import resolve
from tsbench.scenarios.data_set import DataSet

STILL = np.zeros(2, dtype=np.float32)


def onward(observation: Observation) -> Control:
    return aim(0.1, 0.0, observation)


@pytest.fixture
def env() -> Iterator[DriveEnv]:
    made = DriveEnv(split="test")
    yield made
    made.close()


def to_the_end(env: gymnasium.Env[Any, Any], action: Any) -> tuple[list[float], dict[str, Any]]:
    rewards = []
    for _ in range(2000):
        _, reward, terminated, truncated, info = env.step(action)
        rewards.append(float(reward))
        if terminated or truncated:
            return rewards, info
    raise AssertionError("the episode does not end")


def pickled(made: DriveEnv) -> DriveEnv:
    restored: DriveEnv = pickle.loads(pickle.dumps(made))  # noqa: S301  (its own pickle)
    return restored


@pytest.mark.parametrize("kind", ["vector", "bev", "objects", "scene"])
@pytest.mark.filterwarnings("ignore")
def test_gymnasiums_checker_passes_without_a_screen(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "MPLBACKEND"):
        monkeypatch.delenv(name, raising=False)
    made = gymnasium.make(DRIVE, split="test", observation=kind)
    assert made.unwrapped.metadata["render_modes"] == ["rgb_array"]
    check_env(made.unwrapped)
    made.close()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_the_checker_of_stable_baselines_passes() -> None:
    from stable_baselines3.common.env_checker import check_env as check

    for kind in ("vector", "bev", "objects"):
        made = gymnasium.make(DRIVE, split="test", observation=kind)
        check(made.unwrapped)
        made.close()


def test_it_drives_what_a_run_drives(env: DriveEnv) -> None:
    row = next(r for r in DataSet().table("test") if r.scenario_type == "yield" and r.density > 0)
    runner = EpisodeRunner(resolve(f"{__file__}:onward"))
    result = runner.run(row)
    _, told = env.reset(options={"scenario_id": row.scenario_id})
    assert told["scenario_id"] == row.scenario_id
    rewards, info = to_the_end(env, np.array([0.1, 0.0]))
    assert info["outcome"] == str(result.outcome)
    assert len(rewards) == len(result.commands)
    assert info["scd"] == (result.facts.verdicts.compliant and result.outcome == "arrived")


def test_a_held_action_is_the_same_driving(env: DriveEnv, drive_env: Callable[..., DriveEnv]) -> None:
    held = drive_env(split="test", hold=5)
    name = sorted(env._by_id)[0]
    env.reset(options={"scenario_id": name})
    each, one = to_the_end(env, STILL)
    held.reset(options={"scenario_id": name})
    fifth, other = to_the_end(held, STILL)
    # The terms are of the last step alone, which is longer for one of them.
    assert one.pop("reward_terms") != other.pop("reward_terms")
    assert one == other
    assert len(fifth) == -(-len(each) // 5)
    assert sum(fifth) == pytest.approx(sum(each))


def test_a_seed_decides_the_scenarios(env: DriveEnv) -> None:
    def drawn(seed: int) -> list[str]:
        return [env.reset(seed=seed if k == 0 else None)[1]["scenario_id"] for k in range(3)]

    assert drawn(7) == drawn(7)
    assert drawn(7) != drawn(8)


def test_more_of_a_type_is_drawn_three_times_as_often(drive_env: Callable[..., DriveEnv]) -> None:
    made = drive_env(split="test", types="speed_limit,yield", more="yield")
    kinds = [row.pair_type for row in made._rows]
    assert (kinds.count("yield"), kinds.count("speed_limit")) == (1200, 400)
    assert len(made._by_id) == 800


def test_the_route_is_worth_one(env: DriveEnv) -> None:
    name = next(r.scenario_id for r in env._rows if r.scenario_type == "speed_limit" and r.variant == 0)
    env.reset(options={"scenario_id": name})
    rewards, info = to_the_end(env, STILL)
    assert info["outcome"] == "arrived"
    assert 0.4 < sum(rewards) <= 1.0 + 1e-9
    assert all(0.0 <= r < 0.5 for r in rewards)


def test_leaving_the_road_costs(env: DriveEnv, drive_env: Callable[..., DriveEnv]) -> None:
    steered = drive_env(split="test", action="steer")
    steered.reset(options={"scenario_id": env._rows[0].scenario_id})
    rewards, info = to_the_end(steered, np.array([0.3, -0.2]))
    assert info["outcome"] in ("off_road", "collision")
    assert rewards[-1] < -0.9


def test_another_environment_takes_the_simulation(env: DriveEnv) -> None:
    other = DriveEnv(split="test")
    env.reset(seed=0)
    other.reset(seed=0)
    with pytest.raises(gymnasium.error.ResetNeeded, match=r'one simulation per process.*vectorization_mode="async"'):
        env.step(STILL)
    env.close()
    other.step(STILL)
    other.close()


@pytest.mark.parametrize(
    ("asked", "word"),
    [
        ({"split": "val"}, "split 'val'"),
        ({"split": "dev", "observation": "lidar"}, "observation 'lidar'"),
        ({"split": "dev", "action": "pedals"}, r"action 'pedals': expected aim \| steer \| cruise \| exit"),
        (
            {"split": "dev", "types": "yeild"},
            r"^types yeild: no such type or group \(did you mean yield\?\): groups are",
        ),
        ({"split": "dev", "more": "yeild"}, r"^more yeild: no such type or group \(did you mean yield\?\)"),
        ({"split": "dev", "hold": 0}, "hold 0"),
        ({"split": "dev", "hold": 2.5}, r"hold 2\.5: expected a whole number"),
        ({"split": "dev", "hold": True}, "hold True: expected a whole number"),
        ({"split": "dev", "types": []}, r"types \[\]: names no type"),
        ({"split": "dev", "types": 3}, "types 3: expected types and groups"),
        ({"split": "dev", "more": 3}, "more 3: expected types and groups"),
        ({"split": "dev", "mask_signs": "no"}, "mask_signs 'no': expected True or False"),
        ({"split": "dev", "reward": 3}, "reward 3: expected a RewardSpec"),
        ({"split": "dev", "reward": {"violations": -1.0}}, "reward {'violations': -1.0}: "),
        ({"split": "dev", "city": 3}, "city 3: expected"),
        ({"split": "dev", "city": "atlantis"}, "atlantis"),
    ],
)
def test_wrong_options_are_one_line(asked: dict[str, Any], word: str) -> None:
    with one_line(match=word):
        DriveEnv(**asked)


def test_unknown_scenarios_and_broken_actions_are_refused(env: DriveEnv) -> None:
    with pytest.raises(InputError, match="nowhere"):
        env.reset(options={"scenario_id": "nowhere"})
    env.reset(seed=0)
    with pytest.raises(ValueError, match="not finite"):
        env.step(np.array([np.nan, 0.0]))
    for wrong, shape in ((np.zeros(3), r"\(3,\)"), (np.zeros((1, 2)), r"\(1, 2\)"), (0.5, r"\(\)")):
        with pytest.raises(ValueError, match=rf"action of shape {shape}: expected one of Box\(-1.0, 1.0, \(2,\)"):
            env.step(wrong)
    assert env.step(np.zeros(2))[1] >= 0.0


@pytest.mark.parametrize(
    ("given", "told"), [(math.nan, "nan"), (None, "None"), ("much", "'much'"), (np.zeros(2), r"array\(\[0., 0.\]\)")]
)
def test_a_reward_that_is_no_number_is_refused(given: Any, told: str) -> None:
    with closing(DriveEnv(split="dev", types="yield", reward=lambda _: given)) as env:
        env.reset(seed=0)
        with pytest.raises(
            ValueError, match=rf"^reward {told} of \{{'progress': .*: the function must return one finite"
        ):
            env.step(np.zeros(2))


def test_make_vec_by_default_gives_each_a_process() -> None:
    several = gymnasium.make_vec(
        DRIVE, num_envs=2, split="dev", types="speed_limit", observation="vector", action="aim"
    )
    seen, _ = several.reset(seed=3)
    assert seen.shape == (2, 275)
    for _ in range(3):
        seen, reward, *_ = several.step(np.zeros((2, 2), dtype=np.float32))
    assert np.all(reward > 0.0)
    several.close()


def test_perception_reaches_what_is_seen(drive_env: Callable[..., DriveEnv]) -> None:
    plates = {}
    for level in ("exact", "poor"):
        made = drive_env(split="dev", types="speed_limit", observation="scene", perception=level, half="signed")
        made.reset(options={"scenario": min(made._by_id)})
        codes = 0.0
        for _ in range(20):
            seen, *_ = made.step(STILL)
            # The last column is that of a post whose plate is not known.
            codes += float(seen["plates"][:, 6 + 2 : -1].sum())
        plates[level] = codes
    assert plates["poor"] < plates["exact"]


def test_a_plate_that_the_scene_has_no_column_for_is_named(drive_env: Callable[..., DriveEnv]) -> None:
    made = drive_env(split="dev", types="speed_limit", observation="scene")
    made.reset(seed=0)
    o = made.episode.observation
    foreign = replace(o, signs=(replace(o.signs[0], code="9.99"),))
    with pytest.raises(InputError, match=r"plate '9\.99': not in the catalogue"):
        made._seen.encode(foreign)


@pytest.mark.parametrize("kind", ["vector", "bev", "objects", "scene"])
@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickled])
def test_a_copy_has_the_options_and_the_generator_but_no_episode(
    kind: str, copied: Callable[[DriveEnv], DriveEnv], drive_env: Callable[..., DriveEnv]
) -> None:
    action = "exit" if kind == "scene" else "aim"
    made = drive_env(split="dev", types="yield", observation=kind, action=action, hold=2)
    copied(made).close()
    made.reset(seed=5)
    # A shallow copy shares the generator.
    other = copied(made)
    own = copy.deepcopy(made.np_random)
    with pytest.raises(gymnasium.error.ResetNeeded):
        other.step(np.zeros(3 if kind == "scene" else 2, dtype=np.float32))
    made.step(np.zeros(3 if kind == "scene" else 2, dtype=np.float32))
    seen, info = other.reset()
    assert info["scenario_id"] == made._rows[int(own.integers(len(made._rows)))].scenario_id
    assert other.observation_space.contains(seen)
    other.step(np.zeros(3 if kind == "scene" else 2, dtype=np.float32))
    other.close()


def test_another_city_is_driven_and_stays_the_environments_own() -> None:
    made = gymnasium.make(DRIVE, split="dev", city="north-bayreuth")
    town = DataSet.named("north-bayreuth")
    there = {row.scenario_id for row in town.table("dev")}
    for seed in range(3):
        _, info = made.reset(seed=seed)
        assert info["scenario_id"] in there
        made.step(np.array([0.1, 0.0, 0.0], dtype=np.float32))
    made.close()
    assert not there & {row.scenario_id for row in DataSet().table("dev")}


@pytest.mark.parametrize(("name", "costs"), [(DRIVE, -1.0), (DRIVE_V0, 0.0)])
def test_a_violation_costs_in_the_ids_that_show_plates(name: str, costs: float) -> None:
    made = gymnasium.make(name, split="dev", types="speed_limit", half="signed", observation="vector", action="aim")
    told: dict[str, Any] = {}
    made.reset(seed=0)
    while not told.get("violations"):
        assert "outcome" not in told
        _, _, _, _, told = made.step(np.array([0.5, 0.0], dtype=np.float32))
    assert told["reward_terms"]["violation"] == costs * len(told["violations"])
    made.close()


@pytest.mark.parametrize("name", [DRIVE, DRIVE_V0])
def test_an_environment_is_made_again_from_its_json(name: str) -> None:
    assert gymnasium.spec(name).max_episode_steps == MAX_STEPS > max(r.horizon for r in DataSet().table("dev"))
    made = gymnasium.make(name, split="dev")
    again = gymnasium.make(EnvSpec.from_json(made.spec.to_json()))
    assert again.unwrapped._reward_spec == made.unwrapped._reward_spec  # type: ignore[attr-defined]
    assert again.unwrapped._by_id == made.unwrapped._by_id  # type: ignore[attr-defined]
    made.close()
    again.close()


def test_stages_follow_each_other() -> None:
    made = Curriculum(DriveEnv(split="dev"), [(2, {"half": "signed"}), (1, {"half": "contrast"})])
    halves = [made.reset(seed=k)[1]["half"] for k in range(5)]
    assert halves == ["signed"] * 2 + ["contrast"] * 3
    assert made.reset(options={"half": "signed"})[1]["half"] == "signed"
    made.close()
    with pytest.raises(InputError, match="at least one stage"):
        Curriculum(made.env, [])
