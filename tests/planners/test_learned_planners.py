"""`ppo` and `carl` as planners, with random weights."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_line import one_line
from learned_scenes import Recorder, ppo_tensors, save_carl, save_ppo
from scipy.special import betaincinv, ndtri

from tsbench.cli.network_arithmetic import questions
from tsbench.learn.rl.actions import HOLD_TICKS, LearnedPlanner, accelerate, aim, steer
from tsbench.learn.rl.carl_planner import Carl
from tsbench.learn.rl.ppo_planner import Ppo
from tsbench.planners.registry import resolve
from tsbench.planners.weights import load_weights, save_weights

Make = Callable[[Path], LearnedPlanner]
BOTH = [
    pytest.param(lambda p: Ppo(folder=save_ppo(p)), id="ppo"),
    pytest.param(lambda p: Carl(folder=save_carl(p)), id="carl", marks=pytest.mark.slow),
]


@pytest.mark.parametrize("make", BOTH)
def test_an_action_holds(make: Make, drive: Recorder, tmp_path: Path) -> None:
    planner = make(tmp_path)
    planner.reset(drive.context)
    accelerations = [planner.act(o).acceleration for o in drive.seen]
    for k, o in enumerate(drive.seen):
        assert accelerations[k] == accelerations[o.step - o.step % HOLD_TICKS]


def test_carl_runs_on_a_gpu_too_and_ppo_on_the_cpu_only(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    monkeypatch.setattr(Carl, "network", staticmethod(lambda device, *_: asked.append(device) or len))
    for device in ("cpu", "cuda"):
        for name in ("carl", "carl-e", "ppo"):
            resolve(name).on(device).factory()
    assert asked == ["cpu", "cpu", "cuda", "cuda"]


def test_foreign_tensors_are_one_line(tmp_path: Path) -> None:
    save_weights("carl", tmp_path, ppo_tensors(), {})
    with one_line(match="are not those of carl's network"):
        Carl(folder=tmp_path)


@pytest.mark.slow
def test_carl_answers_as_by_torch(tmp_path: Path) -> None:
    from tsbench.learn.rl.policy import densities_by_torch

    asked = questions("carl")
    mine = Carl.network("cpu")(asked)["action"]
    densities = densities_by_torch(load_weights("carl"), "cpu")(asked)
    its = [2.0 * betaincinv(a, b, p) - 1.0 for (a, b), p in zip(densities, asked["draw"], strict=True)]
    assert np.abs(its).max() > 0.1
    assert np.abs(mine - its).max() < 1e-4


def test_ppo_answers_as_float64_does() -> None:
    asked, tensors = questions("ppo"), load_weights("ppo")
    x = asked["vector"].astype(np.float64)
    for name in ("hidden.0", "hidden.1"):
        x = np.tanh(x @ tensors[f"{name}.weight"].T + tensors[f"{name}.bias"])
    mean = x @ tensors["action.weight"].T + tensors["action.bias"]
    its = mean + np.exp(tensors["action.log_std"]) * ndtri(asked["draw"])
    assert np.abs(Ppo().infer(asked)["action"] - its).max() < 1e-4


@pytest.mark.parametrize("name", ["ppo", "carl"])
def test_answers_do_not_hang_on_the_company(name: str) -> None:
    infer = Ppo().infer if name == "ppo" else Carl().infer
    asked = np.concatenate([questions(name)] * 4)
    asked["draw"] = np.random.default_rng(1).random((16, 2))
    alone = [infer(asked[k : k + 1]).tobytes() for k in range(16)]
    for size in range(2, 17):
        assert infer(asked[:size]).tobytes() == b"".join(alone[:size])
        assert infer(asked[16 - size :]).tobytes() == b"".join(alone[16 - size :])


def test_actions_mean_what_they_say(drive: Recorder) -> None:
    o = drive.seen[5]
    assert accelerate(1.0) == 2.4
    assert accelerate(-1.0) == -5.0
    assert accelerate(0.0) == 0.0
    assert np.all(np.diff([accelerate(v) for v in np.linspace(-1, 1, 21)]) > 0)
    assert abs(aim(0.0, 0.0, o).steering) < 1e-3
    assert aim(0.0, 1.0, o).steering > 0.02
    assert aim(0.0, -1.0, o).steering == pytest.approx(-aim(0.0, 1.0, o).steering, abs=1e-3)
    assert steer(0.0, 1.0, o).steering == pytest.approx(np.radians(40.0))
    assert aim(7.0, 9.0, o) == aim(1.0, 1.0, o)
