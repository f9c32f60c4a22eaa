"""Teach a plain MLP to read plates: PPO of Stable-Baselines3 on the pairs of one group, from scratch.

python examples/train_sb3.py --group speed --steps 800000 --out runs/sb3-speed
tsbench planners from-sb3 runs/sb3-speed/model.zip

A row of `curve.csv`, `curve.png` and a checkpoint each minute; the same command goes on from the last one. Needs the
extras `learn` and `report` (for the curve).
"""

import argparse
import csv
import time
from collections import deque
from functools import partial
from pathlib import Path

import gymnasium
import torch
from matplotlib.figure import Figure
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import SubprocVecEnv

import tsbench.learn.envs

HOLD = 3  # ticks of 0.1 s per decision
ROLLOUT = 2048  # decisions of each process between two updates
# What a decision costs (the whole way is worth 1), and which share of the way has to be made in PATIENCE_S.
TIME, LEAST, PATIENCE_S = 0.005, 0.1, 12.0
SIGNED_FIRST = 20_000  # decisions of each process
# Logarithm of each action's first standard deviation: speed (in routing: acceleration), place beside the route, exit.
# With SB3's 0 the first policy swerves; with a narrow first number it never finds out what braking is worth.
WIDTHS = {"priority": (-0.8, -2.0), "speed": (-0.5, -2.0), "obstacles": (-0.8, -0.8), "routing": (-0.8, -2.0, -1.4)}
SHOWN = 400  # episodes in each row of the curve
EVERY_S = 60.0
COLUMNS = ("steps", "episodes", "scd", "scd_signed", "scd_contrast", "arrived")


class Curve(BaseCallback):
    """A row of the curve, its picture and a checkpoint each minute."""

    def __init__(self, out: Path) -> None:
        super().__init__()
        self.out, self.last, self.episodes = out, time.monotonic(), 0
        self.ended: deque[tuple[str, bool, bool]] = deque(maxlen=SHOWN)

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
        axes.plot([int(r["steps"]) / 1e6 for r in rows], [float(r[name]) for r in rows], label=name.replace("_", ", "))
    axes.set(xlabel="million decisions", ylabel=f"% of the last {SHOWN} training episodes", ylim=(0, 100))
    axes.legend(frameon=False)
    figure.savefig(picture, dpi=120)


class Strict(gymnasium.Wrapper):  # type: ignore[type-arg]
    """Time has a price, and an episode ends when it is lost: with the first violation or needless act, or by creeping.

    What comes after teaches nothing about the plate. The last `info` says which half it was. begun: decisions of
    earlier sessions. The first SIGNED_FIRST show signed halves alone: a policy that drives fast everywhere does not
    find out what a plate asks.
    """

    def __init__(self, env: gymnasium.Env, begun: int) -> None:  # type: ignore[type-arg]
        super().__init__(env)
        self.taken = begun

    def reset(self, **options):  # type: ignore[no-untyped-def]
        if self.taken < SIGNED_FIRST:
            options["options"] = {"half": "signed"}
        seen, info = self.env.reset(**options)
        self.half = info["half"]
        self.made = deque([1.0], maxlen=round(PATIENCE_S / (0.1 * HOLD)))
        return seen, info

    def step(self, action):  # type: ignore[no-untyped-def]
        seen, reward, terminated, truncated, info = self.env.step(action)
        self.taken += 1
        self.made.append(info["reward_terms"]["progress"])
        broken = bool(info["violations"] or info["needless"])
        if not (terminated or truncated) and (broken or sum(self.made) < LEAST):
            # Creeping costs what not arriving in time does.
            terminated, reward = True, reward - (0.0 if broken else 1.0)
            info = {**info, "scd": False, "outcome": "lost"}
        return seen, reward - TIME, terminated, truncated, {**info, "half": self.half}


def steps_of(table: Path) -> int:
    """Steps until the last checkpoint."""
    with table.open() as file:
        return int(list(csv.DictReader(file))[-1]["steps"])


def make(group: str, begun: int) -> gymnasium.Env:  # type: ignore[type-arg]
    action = "exit" if group == "routing" else "cruise"
    seen = "scene" if group == "routing" else "plates"
    environment = gymnasium.make(tsbench.learn.envs.DRIVE, types=group, observation=seen, action=action, hold=HOLD)
    return Strict(environment, begun)


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--group", choices=sorted(WIDTHS), default="speed")
    asked.add_argument("--steps", type=int, default=800_000)
    asked.add_argument("--workers", type=int, default=6)
    asked.add_argument("--seed", type=int, default=0)
    asked.add_argument("--out", type=Path, default=Path("runs/sb3-speed"))
    given = asked.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    kept = given.out / "model.zip"
    taken = steps_of(given.out / "curve.csv") if kept.exists() else 0
    begin = partial(make, given.group, taken // given.workers)
    environments = SubprocVecEnv([begin] * given.workers, start_method="forkserver")
    torch.set_num_threads(1)
    model = PPO(
        "MultiInputPolicy",
        environments,
        n_steps=ROLLOUT,
        batch_size=1024,
        gamma=0.995,
        policy_kwargs={"net_arch": [256, 256]},
        seed=given.seed,
        device="cpu",
    )
    model.set_logger(Logger(folder=None, output_formats=[]))  # its own makes an empty folder in /tmp
    with torch.no_grad():
        model.policy.log_std.copy_(torch.tensor(WIDTHS[given.group]))
    if kept.exists():
        # Tensors only: `PPO.load` would open pickles.
        model.set_parameters(kept, device="cpu")
        model.num_timesteps = taken
        model.set_random_seed(given.seed + taken)
    curve = Curve(given.out)
    left = given.steps - model.num_timesteps
    if left > 0:
        model.learn(left, callback=curve, reset_num_timesteps=False)
        curve.keep()
    environments.close()


if __name__ == "__main__":
    main()
