"""How `ppo` and `carl` begin: by what `idm` would do."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv

from tsbench.learn.envs.drive_env import DriveEnv
from tsbench.learn.rl.actions import HOLD_TICKS, accelerate, action_for
from tsbench.learn.rl.dagger import DaggerWrapper, warm_up
from tsbench.learn.rl.policy import policy_of
from tsbench.learn.rl.ppo_planner import SIZE
from tsbench.planners.idm import Idm

pytestmark = pytest.mark.slow


@given(st.floats(-5.0, 2.4), st.floats(-3.5, 3.5))
def test_an_acceleration_and_a_place_beside_the_route_have_an_action(wanted: float, aside: float) -> None:
    first, second = action_for(wanted, aside)
    assert accelerate(first) == pytest.approx(wanted, abs=1e-9)
    assert 3.5 * second * abs(second) == pytest.approx(aside, abs=1e-9)


@pytest.mark.parametrize(("wanted", "most"), [(9.0, 2.4), (-9.0, -5.0)])
def test_what_no_action_reaches_is_cut(wanted: float, most: float) -> None:
    assert accelerate(action_for(wanted, 0.0)[0]) == most


class Mirror(gymnasium.Env[Any, Any]):
    """Shows a number in every place; its teacher answers the opposite. Wrong answers cost."""

    action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
    observation_space = spaces.Box(-2.0, 2.0, (SIZE,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        super().reset(seed=seed)
        self._ticks = 0
        return self._show(), {}

    def step(self, action: Any) -> Any:
        cost = -abs(float(action[0]) + self._value)
        self._ticks += 1
        return self._show(), cost, self._ticks == 16, False, {}

    def advise(self) -> Any:
        return np.array([-self._value, 0.0], dtype=np.float32)

    def _show(self) -> Any:
        self._value = float(self.np_random.uniform(-0.8, 0.8))
        return np.full(SIZE, self._value, dtype=np.float32)


def test_the_policy_learns_what_the_teacher_says() -> None:
    torch.set_num_threads(1)
    kind, arguments = policy_of("ppo")
    environments = DummyVecEnv([Mirror] * 2)
    environments.seed(0)
    model = PPO(kind, environments, n_steps=128, batch_size=32, policy_kwargs=arguments, seed=0, device="cpu")
    seen = np.repeat(np.linspace(-0.8, 0.8, 9, dtype=np.float32)[:, None], SIZE, axis=1)
    before, _ = model.predict(seen, deterministic=True)
    told: list[str] = []
    kept: list[int] = []
    warm_up(model, environments, range(1, 5), 40, 0, told.append, kept.append)
    after, _ = model.predict(seen, deterministic=True)
    assert np.abs(before[:, 0] + seen[:, 0]).mean() > 0.3
    assert np.abs(after[:, 0] + seen[:, 0]).mean() < 0.1
    assert len(told) == 4
    assert kept == [2, 3, 4, 5]
    # PPO's own optimiser has not moved.
    assert not model.policy.optimizer.state_dict()["state"]


def test_the_teacher_sees_what_a_planner_sees() -> None:
    taught = DaggerWrapper(DriveEnv(split="test"))
    taught.reset(options={"scenario_id": sorted(taught.unwrapped._by_id)[0]})
    turn = taught.unwrapped.episode
    idm = Idm()
    idm.reset(turn.context)
    wanted = idm.act(turn.observation).acceleration
    assert accelerate(float(taught.advise()[0])) == pytest.approx(np.clip(wanted, -5.0, 2.4), abs=1e-5)
    taught.close()


def test_the_teacher_passes_an_obstacle() -> None:
    taught = DaggerWrapper(DriveEnv(split="test", hold=HOLD_TICKS))
    taught.reset(options={"scenario_id": next(i for i in sorted(taught.unwrapped._by_id) if "detour_left" in i)})
    aside, over, facts = [], False, {}
    while not over:
        action = taught.advise()
        aside.append(float(action[1]))
        _, _, ended, cut, facts = taught.step(action)
        over = ended or cut
    assert facts["outcome"] == "arrived"
    assert max(map(abs, aside)) > 0.5
    taught.close()
