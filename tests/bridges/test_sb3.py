"""Policies of Stable-Baselines3 as planners: the same answers, and nothing that is in the file is run."""

from __future__ import annotations

import base64
import json
import pickle
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.spaces.utils import flatten

from tsbench.bridges.sb3 import Sb3Planner, _loaded
from tsbench.bridges.sb3.convert import convert
from tsbench.cli import main
from tsbench.core.errors import InputError
from tsbench.episode.runner import EpisodeRunner
from tsbench.learn.envs.drive_env import DriveEnv
from tsbench.learn.envs.seen_tables import KINDS
from tsbench.planners.registry import resolve
from tsbench.run.planner_info import describe
from tsbench.scenarios.data_set import DataSet

# Stable-Baselines3 and torch are large: they are imported where they are needed, in processes of their own.
if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

pytestmark = pytest.mark.slow

PLAIN = {"draws": False, "name": "Policy"}


class Spaces(gymnasium.Env[Any, Any]):
    """The environment's spaces without its simulation."""

    def __init__(self, observation: str, action: str, hold: int = 1) -> None:
        self.observation_space = KINDS[observation]().space
        drives = DriveEnv(split="dev", observation=observation, action=action, hold=hold)
        self.action_space, self.shown = drives.action_space, []

    def reset(self, **_: Any) -> tuple[Any, dict[str, Any]]:
        return self.step(None)[0], {}

    def step(self, _: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.shown.append(self.observation_space.sample())
        return self.shown[-1], 0.0, False, False, {}


def policy(kind: str, **more: Any) -> BaseAlgorithm:
    from stable_baselines3 import A2C, PPO, SAC, TD3
    from torch import nn

    small = {"seed": 3, "device": "cpu"}
    vector = Spaces("vector", "aim", more.pop("hold", 1))
    if kind == "ppo":
        return PPO("MlpPolicy", vector, **small, **more)
    if kind == "ppo-exit":
        return PPO("MultiInputPolicy", Spaces("scene", "exit", 3), **small, **more)
    if kind == "a2c-relu":
        return A2C("MlpPolicy", vector, policy_kwargs={"activation_fn": nn.ReLU}, **small)
    of = SAC if kind == "sac" else TD3
    return of("MlpPolicy", vector, buffer_size=10, policy_kwargs={"net_arch": [32, 32]}, **small)


def saved(folder: Path, model: BaseAlgorithm) -> Path:
    path = folder / "model.zip"
    model.save(path)
    return path


def test_it_answers_as_the_policy_does(tmp_path: Path) -> None:
    for kind in ("ppo", "ppo-exit", "a2c-relu", "sac", "td3"):
        compare(kind, tmp_path / kind)


def compare(kind: str, folder: Path) -> None:
    model = policy(kind)
    folder.mkdir()
    # As from training: biases that are not zero, answers that are not all small.
    for k, tensor in enumerate(model.policy.parameters()):
        tensor.data += 0.05 * np.cos(k)
    made = convert(saved(folder, model), folder / "out", **PLAIN)
    assert made.training["observation"] == ("scene" if kind == "ppo-exit" else "vector")
    assert made.training["activation"] == ("tanh" if kind.startswith("ppo") else "relu")
    answer, _ = _loaded(folder / "out")
    space = model.observation_space
    space.seed(5)
    for _ in range(20):
        seen = space.sample()
        mine = np.clip(answer(np.asarray(flatten(space, seen), dtype=np.float64)[None])[0], -1.0, 1.0)
        theirs, _ = model.predict(seen, deterministic=True)
        assert mine == pytest.approx(theirs, abs=2e-4)
        assert np.abs(theirs).max() > 1e-3


def test_it_drives_by_the_command_that_is_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = saved(tmp_path, policy("ppo-exit"))
    with pytest.raises(SystemExit, match="0"):
        main(["planners", "from-sb3", str(path), "--name", "Mine"])
    spec = str(tmp_path / "model" / "planner.py") + ":Mine"
    told = capsys.readouterr().out
    assert "sees scene, acts by exit, a decision each 3 ticks" in told
    assert f"tsbench run --planner {spec} --split dev" in told
    loaded = resolve(spec)
    assert (loaded.name, loaded.sign_access, loaded.chooses_route) == ("Mine", True, True)
    row = DataSet().table("dev")[0]
    first, second = (EpisodeRunner(loaded).run(row) for _ in range(2))
    assert not first.error
    ways = [[(step.ego.x, step.ego.y) for step in one.facts.snapshots] for one in (first, second) if one.facts]
    assert ways[0] == ways[1]
    assert len(ways[0]) > 10
    # Weights count with the planner's code.
    before = describe(spec).code_sha256
    other = saved(tmp_path, policy("ppo-exit", policy_kwargs={"log_std_init": -1.0}))
    convert(other, tmp_path / "model", **{**PLAIN, "name": "Mine"})
    assert describe(spec).code_sha256 != before


def test_draws_are_of_the_episodes_seed_and_decisions_hold(tmp_path: Path) -> None:
    from learned_scenes import record

    drive = record()
    convert(saved(tmp_path, policy("ppo", hold=2)), tmp_path / "out", **{**PLAIN, "draws": True})

    class Mine(Sb3Planner):
        folder = tmp_path / "out"

    def actions() -> list[tuple[float, ...]]:
        planner, found = Mine(), []
        planner.reset(drive.context)
        for observation in drive.seen[:6]:
            planner.act(observation)
            found.append(planner._action)
        return found

    assert actions() == actions()
    steps = [observation.step for observation in drive.seen[:6]]
    found = actions()
    for k in range(5):
        assert (found[k] == found[k + 1]) is (steps[k] // 2 == steps[k + 1] // 2)


@pytest.mark.parametrize("seen", ["vector", "plates"])
@pytest.mark.parametrize("by", ["VecFrameStack", "FrameStackObservation"])
def test_frames_are_stacked_as_in_training(seen: str, by: str, tmp_path: Path) -> None:
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import DummyVecEnv, VecFrameStack

    env = Spaces(seen, "aim")
    if by == "VecFrameStack":
        several: Any = VecFrameStack(DummyVecEnv([lambda: env]), 3)
    else:
        several = DummyVecEnv([lambda: gymnasium.wrappers.FrameStackObservation(env, 3)])
    kind = "MlpPolicy" if seen == "vector" else "MultiInputPolicy"
    model = PPO(kind, several, device="cpu")
    made = convert(saved(tmp_path, model), tmp_path / "out", **PLAIN)
    assert (made.training["observation"], made.training["frames"]) == (seen, 3)

    class Mine(Sb3Planner):
        folder = tmp_path / "out"

    planner = Mine()
    stacked, space = several.reset(), several.observation_space
    for _ in range(5):
        one = {name: values[0] for name, values in stacked.items()} if seen == "plates" else stacked[0]
        assert np.array_equal(planner._stacked(env.shown[-1]), flatten(space, one))
        stacked, *_ = several.step(np.zeros((1, 2)))


class Boom:
    def __reduce__(self) -> tuple[Any, ...]:
        return (Path("boom").touch, ())


def test_no_pickle_is_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path, evil = saved(tmp_path, policy("ppo")), tmp_path / "evil.zip"
    boom = pickle.dumps(Boom(), protocol=2)
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(evil, "w") as new:
        data = json.loads(old.read("data"))
        for value in data.values():
            if isinstance(value, dict) and ":serialized:" in value:
                value[":serialized:"] = base64.b64encode(boom).decode()
        new.writestr("data", json.dumps(data))
        new.writestr("policy.pth", old.read("policy.pth"))
    assert convert(evil, tmp_path / "out", **PLAIN).training["from"] == "PPO or A2C"
    with zipfile.ZipFile(evil, "w") as new:
        new.writestr("data", "{}")
        new.writestr("policy.pth", boom)
    with pytest.raises(InputError, match="cannot be read as a model of Stable-Baselines3"):
        convert(evil, tmp_path / "out", **PLAIN)
    assert not (tmp_path / "boom").exists()
    pickle.loads(boom)  # noqa: S301  (the test's own)
    assert (tmp_path / "boom").exists(), "opened, it would have run"


def test_what_it_cannot_take_is_one_line(tmp_path: Path) -> None:
    path = saved(tmp_path, policy("ppo"))

    def refused(match: str, file: Path = path, **changes: Any) -> None:
        with pytest.raises(InputError, match=match):
            convert(file, tmp_path / "out", **{**PLAIN, **changes})

    refused("--name mine: expected a class name", name="mine")
    refused("--draws is for PPO and A2C", saved(tmp_path, policy("sac")), draws=True)
    from stable_baselines3 import PPO
    from torch import nn

    other = PPO("MlpPolicy", gymnasium.make("Pendulum-v1"), device="cpu")
    refused("does not say what it was trained with: train it in tsbench/Drive-v1", saved(tmp_path, other))
    narrow = Spaces("vector", "aim")
    narrow.observation_space = spaces.Box(-1.0, 1.0, (3,), np.float32)
    refused("a network of 3 inputs: expected 275", saved(tmp_path, PPO("MlpPolicy", narrow, device="cpu")))
    tables = PPO("MultiInputPolicy", Spaces("objects", "aim"), device="cpu")
    refused("policies of `objects` cannot be taken; expected one of vector", saved(tmp_path, tables))
    later = Spaces("vector", "aim")
    later.action_space.drive["action"] = "fly"
    refused("trained with .*fly.*, which this version's", saved(tmp_path, PPO("MlpPolicy", later, device="cpu")))
    odd = policy("ppo", policy_kwargs={"activation_fn": nn.ELU})
    refused("expected Tanh or ReLU", saved(tmp_path, odd))
    broken = tmp_path / "broken.zip"
    broken.write_bytes(b"PK")
    refused("broken.zip: cannot be read", broken)
    refused("none.zip", tmp_path / "none.zip")
    with zipfile.ZipFile(broken, "w") as new:
        new.writestr("data", "{}")
    refused("it has no policy.pth", broken)
