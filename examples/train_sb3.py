"""Teach a plain MLP to read plates: PPO of Stable-Baselines3 on the pairs of one group, from scratch.

python examples/train_sb3.py --group speed --steps 2000000 --out runs/sb3-speed
tsbench planners from-sb3 runs/sb3-speed/model.zip --hold 3

A row of `curve.csv`, `curve.png` and a checkpoint each minute; the same command goes on from the last one. Needs the
extras `learn` and `report` (for the curve).
"""

import argparse
import csv
import time
from collections import deque
from pathlib import Path

import gymnasium
import torch
from matplotlib.figure import Figure
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import SubprocVecEnv

import tsbench.envs
from tsbench.envs.reward import RewardSpec

HOLD = 3  # ticks of 0.1 s per decision
SHOWN = 400  # episodes in each row of the curve
EVERY_S = 60.0
COLUMNS = ("steps", "episodes", "scd", "scd_signed", "scd_contrast", "arrived")


class Curve(BaseCallback):
    """A row of the curve, its picture and a checkpoint each minute."""

    def __init__(self, out: Path) -> None:
        super().__init__()
        self.out, self.last, self.episodes = out, time.monotonic(), 0
        self.ended: deque[tuple[str, bool, bool]] = deque(maxlen=SHOWN)
        self.halves: dict[int, str] = {}

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            if "scd" in info:
                self.episodes += 1
                self.ended.append((info["half"], info["scd"], info["outcome"] == "arrived"))
        return True

    def _on_rollout_end(self) -> None:
        if time.monotonic() - self.last >= EVERY_S:
            self.keep()

    def keep(self) -> None:
        self.last = time.monotonic()
        self.model.save(self.out / "part.zip")
        (self.out / "part.zip").replace(self.out / "model.zip")
        path = self.out / "curve.csv"
        new = not path.exists()
        with path.open("a", newline="") as file:
            rows = csv.writer(file)
            if new:
                rows.writerow(COLUMNS)
            scd = [self.share(half) for half in ("", "signed", "contrast")]
            arrived = 100.0 * sum(a for *_, a in self.ended) / max(len(self.ended), 1)
            row = [self.num_timesteps, self.episodes, *scd, round(arrived, 1)]
            rows.writerow(row)
        print(*(f"{name} {value}" for name, value in zip(COLUMNS, row, strict=True)), sep=", ", flush=True)
        draw(path, self.out / "curve.png")

    def share(self, half: str) -> float:
        found = [scd for where, scd, _ in self.ended if half in ("", where)]
        return round(100.0 * sum(found) / max(len(found), 1), 1)


def draw(table: Path, picture: Path) -> None:
    with table.open() as file:
        rows = list(csv.DictReader(file))
    figure = Figure(figsize=(6.0, 3.2), layout="constrained")
    axes = figure.subplots()
    for name in COLUMNS[2:]:
        axes.plot(
            [int(r["steps"]) / 1e6 for r in rows],
            [float(r[name]) for r in rows],
            label=name.replace("_", ", "),
        )
    axes.set(xlabel="million decisions", ylabel=f"% of the last {SHOWN} training episodes", ylim=(0, 100))
    axes.legend(frameon=False)
    figure.savefig(picture, dpi=120)


class Half(gymnasium.Wrapper):  # type: ignore[type-arg]
    """Says at the end of an episode which half it was."""

    def reset(self, **options):  # type: ignore[no-untyped-def]
        seen, info = self.env.reset(**options)
        self.half = info["half"]
        return seen, info

    def step(self, action):  # type: ignore[no-untyped-def]
        seen, reward, terminated, truncated, info = self.env.step(action)
        return seen, reward, terminated, truncated, {**info, "half": self.half}


def steps_of(table: Path) -> int:
    """Steps until the last checkpoint."""
    with table.open() as file:
        return int(list(csv.DictReader(file))[-1]["steps"])


def make(group: str) -> gymnasium.Env:  # type: ignore[type-arg]
    # What a violation and an act of needless obedience cost is what teaches: the whole way is worth 1.
    action = "exit" if group == "routing" else "aim"
    spec = RewardSpec(violation=-1.0, needless=-1.0)
    return Half(
        gymnasium.make(
            tsbench.envs.DRIVE, types=group, observation="scene", action=action, hold=HOLD, reward=spec
        )
    )


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--group", default="speed")
    asked.add_argument("--steps", type=int, default=2_000_000)
    asked.add_argument("--workers", type=int, default=2)
    asked.add_argument("--seed", type=int, default=0)
    asked.add_argument("--out", type=Path, default=Path("runs/sb3-speed"))
    given = asked.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    environments = SubprocVecEnv([lambda: make(given.group)] * given.workers, start_method="forkserver")
    kept = given.out / "model.zip"
    torch.set_num_threads(1)
    # Narrower than the default, or the first policy only swerves.
    shape = {"log_std_init": -1.4, "net_arch": [256, 256]}
    model = PPO(
        "MultiInputPolicy", environments, batch_size=256, policy_kwargs=shape, seed=given.seed, device="cpu"
    )
    if kept.exists():
        # Tensors only: `PPO.load` would open pickles.
        model.set_parameters(kept, device="cpu")
        model.num_timesteps = steps_of(given.out / "curve.csv")
        model.set_random_seed(given.seed + model.num_timesteps)
    curve = Curve(given.out)
    left = given.steps - model.num_timesteps
    if left > 0:
        model.learn(left, callback=curve, reset_num_timesteps=False)
        curve.keep()
    environments.close()


if __name__ == "__main__":
    main()
