"""Training of `ppo` and `carl`: what is learned is what drives, and a broken-off training goes on."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from command_line import one_line
from gymnasium import spaces
from safetensors.numpy import load_file
from scipy import stats
from stable_baselines3 import PPO
from stable_baselines3.common.logger import Logger

from tsbench.core.errors import InputError
from tsbench.learn.rl import ppo_training as rl_train
from tsbench.learn.rl.carl_planner import CHANNELS, MEASUREMENTS, PIXELS, RECORD, Carl
from tsbench.learn.rl.policy import BetaActions, actor_tensors, policy_of
from tsbench.learn.rl.ppo_planner import RECORD as VECTOR
from tsbench.learn.rl.ppo_planner import SIZE, Ppo
from tsbench.learn.rl.ppo_training import HYPER, Job, RlProgress, load_progress, save_progress, session_seed
from tsbench.planners.weights import network, save_weights

pytestmark = pytest.mark.slow

ACTIONS = spaces.Box(-1.0, 1.0, (2,), np.float32)
SEEN: dict[str, spaces.Space[Any]] = {
    "ppo": spaces.Box(-2.0, 2.0, (SIZE,), np.float32),
    "carl": spaces.Dict(
        {
            "bev": spaces.Box(0, 255, (CHANNELS, PIXELS, PIXELS), np.uint8),
            "measurements": spaces.Box(-2.0, 2.0, (MEASUREMENTS,), np.float32),
        }
    ),
}


def policy(planner: str) -> Any:
    torch.manual_seed(1)
    kind, arguments = policy_of(planner)
    made = kind(SEEN[planner], ACTIONS, lambda _: 1e-3, **arguments)
    # Fresh heads are all but zero: make the actions differ.
    torch.nn.init.normal_(made.action_net.weight, std=0.5)
    return made


def test_the_exported_mlp_acts_as_the_trained_one(tmp_path: Path) -> None:
    made = policy("ppo")
    save_weights("ppo", tmp_path, actor_tensors("ppo", made), {})
    seen = np.random.default_rng(0).uniform(-1, 1, (5, SIZE)).astype(np.float32)
    records = np.zeros(5, dtype=VECTOR)
    records["vector"] = seen
    records["draw"] = np.random.default_rng(1).random((5, 2))
    with torch.no_grad():
        trained = made.get_distribution(torch.from_numpy(seen)).distribution
    wanted = stats.norm(trained.mean.numpy(), trained.stddev.numpy()).ppf(records["draw"])
    assert np.allclose(Ppo(folder=tmp_path).infer(records)["action"], wanted, atol=1e-5)
    assert network("ppo", tmp_path).parameters == 275 * 256 + 256 + 256 * 256 + 256 + 256 * 2 + 2 + 2


def test_the_exported_cnn_acts_as_the_trained_one(tmp_path: Path) -> None:
    made = policy("carl")
    save_weights("carl", tmp_path, actor_tensors("carl", made), {})
    records = np.zeros(4, dtype=RECORD)
    rng = np.random.default_rng(0)
    records["bev"] = rng.integers(0, 256, records["bev"].shape)
    records["measurements"] = rng.uniform(-1, 1, records["measurements"].shape)
    records["draw"] = rng.random((4, 2))
    with torch.no_grad():
        trained = made.get_distribution({k: torch.from_numpy(records[k]) for k in ("bev", "measurements")})._beta
    densities = stats.beta(trained.concentration1.numpy(), trained.concentration0.numpy(), loc=-1.0, scale=2.0)
    wanted = densities.ppf(records["draw"])
    assert np.ptp(wanted) > 0.01
    assert np.allclose(Carl(folder=tmp_path).infer(records)["action"], wanted, atol=1e-4)


def test_beta_actions_have_the_density_of_the_textbook() -> None:
    raw = torch.tensor([[0.3, -0.5, 1.2, 0.1]])
    actions = BetaActions(2).proba_distribution(raw)
    x = torch.tensor([[0.2, -0.6]])
    a, b = (1.0 + torch.nn.functional.softplus(raw)[0]).numpy().reshape(2, 2)
    wanted = stats.beta(a, b, loc=-1.0, scale=2.0).logpdf(x[0].numpy()).sum()
    assert float(actions.log_prob(x)) == pytest.approx(wanted, abs=1e-4)
    assert float(actions.entropy()) == pytest.approx(stats.beta(a, b, loc=-1.0, scale=2.0).entropy().sum(), abs=1e-4)
    mode = actions.mode()[0].numpy()
    density = stats.beta(a, b, loc=-1.0, scale=2.0).pdf
    assert (density(mode) >= density(mode + 1e-3)).all()
    assert (density(mode) >= density(mode - 1e-3)).all()
    drawn = torch.cat([actions.sample() for _ in range(50)])
    assert bool((drawn.abs() <= 1.0).all())


def test_no_session_draws_what_another_drew() -> None:
    assert len({session_seed(seed, k) for seed in range(5) for k in range(5)}) == 25


class Still(gymnasium.Env[Any, Any]):
    """Shows nothing, for ever."""

    action_space = ACTIONS

    def __init__(self, planner: str) -> None:
        self.observation_space = SEEN[planner]

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        super().reset(seed=seed)
        return self.observation_space.sample(), {}

    def step(self, action: Any) -> Any:
        return self.observation_space.sample(), float(action[0]), False, False, {}


@pytest.mark.parametrize("planner", ["ppo", "carl"])
def test_a_checkpoint_holds_everything_that_learns(planner: str, tmp_path: Path) -> None:
    kind, arguments = policy_of(planner)

    def fresh(seed: int) -> PPO:
        return PPO(
            kind, Still(planner), n_steps=8, batch_size=4, n_epochs=1, policy_kwargs=arguments, seed=seed, device="cpu"
        )

    model = fresh(0)
    model.set_logger(Logger(folder=None, output_formats=[]))
    model.learn(8)
    save_progress(tmp_path, model, RlProgress(8, 1.5, 1, 2), {"seed": 0})
    other = fresh(1)
    assert load_progress(tmp_path, other, {"seed": 0}) == RlProgress(8, 1.5, 1, 2, model._n_updates)
    assert other.num_timesteps == 8
    for (name, a), (_, b) in zip(model.policy.named_parameters(), other.policy.named_parameters(), strict=True):
        assert torch.equal(a, b), name
    one, two = (m.policy.optimizer.state_dict()["state"] for m in (model, other))
    assert sorted(one) == sorted(two)
    assert all(torch.equal(one[k][n], two[k][n]) for k in one for n in one[k])

    (tmp_path / "checkpoint.safetensors").write_bytes(b"nothing")
    with one_line(match="is no checkpoint"):
        load_progress(tmp_path, other, {"seed": 0})


def dying_once(learn: Any) -> Any:
    """`learn`, whose first call kills the processes that drive."""
    died: list[bool] = []

    def learn_or_die(model: Any, watch: Any, steps: int) -> None:
        if not died:
            died.append(True)
            for process in model.get_env().venv.processes:
                process.kill()
                process.join()
        learn(model, watch, steps)

    return learn_or_die


@pytest.mark.slow
def test_a_training_goes_on_where_it_broke_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    small = replace(HYPER["ppo"], rollout=16, batch=8, epochs=1, updates=2)
    monkeypatch.setattr(rl_train, "HYPER", {"ppo": small})
    told: list[str] = []
    job = Job("ppo", tmp_path, 16, 1, 3, "cpu", ("speed_limit",))
    first = rl_train.train(job, told.append)
    before = load_file(tmp_path / "checkpoint.safetensors")
    assert first.training["steps"] == 16
    record = np.zeros(1, dtype=VECTOR)
    record["draw"] = 0.5
    assert np.isfinite(Ppo(folder=tmp_path).infer(record)["action"]).all()

    # Every driving process of the second session dies once, at its first step.
    monkeypatch.setattr(rl_train, "_learn", dying_once(rl_train._learn))
    second = rl_train.train(replace(job, steps=32, rate=1e-4, more=("speed",)), told.append)
    after = load_file(tmp_path / "checkpoint.safetensors")
    assert second.training["steps"] == 32
    assert second.training["sessions"] == 2
    assert (first.training["hyper"]["rate"], second.training["hyper"]["rate"]) == (3e-4, 1e-4)
    assert (first.training["more"], second.training["more"]) == ([], ["speed"])
    assert second.weights.sha256 != first.weights.sha256
    assert after["adam.0.step"] == 2 * before["adam.0.step"] > 0
    assert any("continues at 16 of 32" in line for line in told)
    assert sum("a driving process died" in line for line in told) == 1
    curve = [json.loads(line) for line in (tmp_path / "curve.jsonl").read_text().splitlines()]
    assert [row["steps"] for row in curve] == [16, 32]
    assert list((tmp_path / "tensorboard").glob("events.*"))
    assert (tmp_path / "curve.png").stat().st_size > 5_000

    with pytest.raises(InputError, match="seed 3, not 4"):
        rl_train.train(replace(job, seed=4, steps=48), told.append)
