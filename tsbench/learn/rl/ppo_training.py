"""`tsbench train ppo|carl`: PPO of Stable-Baselines3 on `tsbench/Drive-v0`, one process per simulation.

A watch counts how episodes end, tells, logs for TensorBoard, and keeps checkpoints.
"""

from __future__ import annotations

import signal
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import SubprocVecEnv, VecMonitor

import tsbench.learn.envs
from tsbench.core.errors import SimulationError
from tsbench.core.paths import OWN_CITY
from tsbench.learn.envs.reward import RewardSpec
from tsbench.learn.rl.actions import HOLD_TICKS
from tsbench.learn.rl.dagger import DaggerWrapper, warm_up
from tsbench.learn.rl.policy import actor_tensors, policy_of
from tsbench.learn.training_folder import (
    CURVE,
    add_row,
    command_line,
    draw_rl,
    keep_freed_memory,
    load_checkpoint,
    prepare,
    save_checkpoint,
)
from tsbench.planners.weights import Network, save_weights

_WINDOW = 200
_ENDS = ("arrived", "collision", "off_road", "timeout")


@dataclass(frozen=True, slots=True)
class RlProgress:
    """steps: decisions taken since imitation. seconds: of training so far, all sessions together. sessions: how many
    there were. imitated: rollouts of imitation. updates: as Stable-Baselines3 counts them.
    """

    steps: int = 0
    seconds: float = 0.0
    sessions: int = 0
    imitated: int = 0
    updates: int = 0


def save_progress(out: Path, model: PPO, progress: RlProgress, job: dict[str, Any]) -> None:
    now = asdict(replace(progress, updates=model._n_updates))
    save_checkpoint(out, model.policy, model.policy.optimizer, job, now)


def load_progress(out: Path, model: PPO, job: dict[str, Any]) -> RlProgress | None:
    """Restore the state below `out` into a fresh model; None without one. Errors as of `load_checkpoint`."""
    known = load_checkpoint(out, model.policy, model.policy.optimizer, job)
    if known is None:
        return None
    found = RlProgress(**known)
    model._n_updates, model.num_timesteps = found.updates, found.steps
    return found


def session_seed(seed: int, session: int, deaths: int = 0) -> int:
    """What a session draws its scenarios from: never those of another again, nor of one whose process died."""
    return int(np.random.SeedSequence((seed, session, deaths)).generate_state(1)[0] % 2**31)


class ProgressCallback(BaseCallback):
    """At the end of each rollout: one line, one row of the curve; a checkpoint and the picture each `every` seconds.

    before: what earlier sessions have done. tell: prints a line.
    """

    def __init__(
        self, out: Path, job: dict[str, Any], before: RlProgress, total: int, tell: Callable[[str], None], every: float
    ) -> None:
        super().__init__()
        self._out, self._job, self._before, self._total, self._tell = out, job, before, total, tell
        self._every, self._saved = every, time.monotonic()
        self._began, self._told = time.monotonic(), 0.0
        self._ends: deque[str] = deque(maxlen=_WINDOW)
        self._earned: deque[float] = deque(maxlen=_WINDOW)
        self._completion: deque[float] = deque(maxlen=_WINDOW)
        self._broken = 0

    @property
    def progress(self) -> RlProgress:
        """What has been done by now, this session included."""
        seconds = self._before.seconds + time.monotonic() - self._began
        return replace(
            self._before, steps=self.model.num_timesteps, seconds=seconds, sessions=self._before.sessions + 1
        )

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            if "outcome" not in info:
                continue
            if info["error"]:
                self._broken += 1
                self._tell(f"an episode broke off: {info['error']}")
                continue
            self._ends.append(info["outcome"])
            self._earned.append(float(info["episode"]["r"]))
            self._completion.append(float(info["route_completion"]))
        return True

    def _on_rollout_end(self) -> None:
        shares = {name: self._ends.count(name) / max(len(self._ends), 1) for name in _ENDS}
        row: dict[str, float] = {
            "steps": self.num_timesteps,
            "seconds": round(self.progress.seconds, 1),
            "reward": round(float(np.mean(self._earned)), 4) if self._earned else 0.0,
            "route_completion": round(float(np.mean(self._completion)), 2) if self._completion else 0.0,
            **{name: round(share, 4) for name, share in shares.items()},
            "broken": self._broken,
        }
        for name, value in row.items():
            if name not in ("steps", "seconds"):
                self.logger.record(f"episodes/{name}", value)
        add_row(self._out / CURVE, row, "steps")
        now = time.monotonic()
        if now - self._told > 10.0:
            self._told = now
            rate = (self.num_timesteps - self._before.steps) / (now - self._began)
            left = (self._total - self.num_timesteps) / rate / 60.0
            self._tell(
                f"{self.num_timesteps:>9,} of {self._total:,} steps  {rate:5.0f} steps/s  {left:5.0f} min to go  "
                f"reward {row['reward']:+.2f}  arrived {row['arrived']:.2f}  collision {row['collision']:.2f}  "
                f"off road {row['off_road']:.2f}  timeout {row['timeout']:.2f}"
            )
        if now - self._saved > self._every:
            self.keep()

    def keep(self) -> None:
        save_progress(self._out, self.model, self.progress, self._job)  # type: ignore[arg-type]
        draw_rl(self._out)
        self._saved = time.monotonic()


@dataclass(frozen=True, slots=True)
class Hyper:
    """Of PPO (Schulman et al., arXiv 1707.06347), in Stable-Baselines3's terms; a step is one decision.

    rollout: steps of all environments between updates. rate: of Adam, falling to a tenth over the run. threads: of
    torch: more wait for each other as soon as anything else runs, and the driving processes do. imitation, updates:
    rollouts of `dagger` before all that, if not asked for otherwise, and updates after each. gamma: so near to 1 that
    what standing still costs at the end of an episode counts.
    """

    observation: str
    rollout: int
    batch: int
    epochs: int
    rate: float
    threads: int
    imitation: int
    updates: int
    gamma: float = 0.999
    trace: float = 0.95
    clip: float = 0.2
    entropy: float = 0.002
    value: float = 0.5
    gradient: float = 0.5


HYPER: Mapping[str, Hyper] = MappingProxyType(
    {
        "ppo": Hyper("vector", rollout=4096, batch=256, epochs=8, rate=3e-4, threads=1, imitation=40, updates=400),
        "carl": Hyper("bev", rollout=2048, batch=256, epochs=3, rate=2.5e-4, threads=1, imitation=40, updates=60),
    }
)


@dataclass(frozen=True, slots=True)
class Job:
    """One training as asked for. steps: decisions of `HOLD_TICKS` ticks in all. types: as of `tsbench run`.

    imitation: rollouts of `rl.dagger` in all, None = the planner's; asked for later, they go before further steps.
    rate: of Adam at the start of this session, None = the planner's. more: types and groups drawn three times as often.
    """

    planner: str
    out: Path
    steps: int
    workers: int
    seed: int
    device: str
    types: tuple[str, ...]
    imitation: int | None = None
    rate: float | None = None
    more: tuple[str, ...] = ()

    def facts(self) -> dict[str, object]:
        """What a training that is continued must have in common with the one before."""
        return {
            "planner": self.planner,
            "seed": self.seed,
            "split": "train",
            "hold_ticks": HOLD_TICKS,
            "reward": asdict(RewardSpec()),
        }


_CHECKPOINT_S = 60.0
_DEATHS = 20
# Share of the learning rate that is left at the end.
_LAST_RATE = 0.1


class _Stopped(Exception):
    """Asked to stop from outside."""


def train(job: Job, tell: Callable[[str], None]) -> Network:
    """Train up to `job.steps`, from the checkpoint below `job.out` if there is one; returns what it exported.

    A driving process that dies (SUMO can) costs what was learned since the last checkpoint, no more.
    Raises KeyboardInterrupt when it is interrupted or terminated: the same call continues.
    """
    hyper = HYPER[job.planner]
    if job.rate is not None:
        hyper = replace(hyper, rate=job.rate)
    if job.imitation is not None:
        hyper = replace(hyper, imitation=job.imitation)
    prepare(job.out, job.device, hyper.threads)
    keep_freed_memory()
    for deaths in range(_DEATHS):
        try:
            return _session(job, hyper, deaths, tell)
        except (EOFError, ConnectionError):
            tell("a driving process died: goes on from the last checkpoint")
    raise SimulationError(f"driving processes died {_DEATHS} times: {job.out} has the last checkpoint")


def _session(job: Job, hyper: Hyper, deaths: int, tell: Callable[[str], None]) -> Network:
    processes = _processes(job, hyper)
    try:
        environments = VecMonitor(processes)
        model = _model(job, hyper, environments)
        before = load_progress(job.out, model, job.facts()) or RlProgress()
        if before.sessions:
            tell(f"continues at {before.steps:,} of {job.steps:,} steps")
        processes.seed(session_seed(job.seed, before.sessions, deaths))
        if before.imitated < hyper.imitation:
            before = _imitate(job, hyper, model, environments, before, tell)
        watch = ProgressCallback(job.out, job.facts(), before, job.steps, tell, _CHECKPOINT_S)
        if before.steps < job.steps:
            _learn(model, watch, job.steps - before.steps)
        return _export(job, hyper, model, watch.progress if before.steps < job.steps else before)
    finally:
        # Not their own way to close: it waits for answers, which dead ones do not give.
        for process in processes.processes:
            process.terminate()
            process.join()


def _imitate(
    job: Job, hyper: Hyper, model: PPO, environments: VecMonitor, before: RlProgress, tell: Callable[[str], None]
) -> RlProgress:
    """The rollouts of imitation that are missing, with checkpoints, which do not hold what was remembered."""
    began = saved = time.monotonic()
    done = before

    def keep(imitated: int) -> None:
        nonlocal saved, done
        now = time.monotonic()
        done = replace(before, seconds=before.seconds + now - began, imitated=imitated)
        if now - saved > _CHECKPOINT_S or imitated == hyper.imitation:
            saved = now
            # What is loaded is another session; what is returned goes on in this one.
            save_progress(job.out, model, replace(done, sessions=before.sessions + 1), job.facts())

    rollouts = range(before.imitated, hyper.imitation)
    warm_up(model, environments, rollouts, hyper.updates, job.seed, tell, keep)
    return done


def _learn(model: PPO, watch: ProgressCallback, steps: int) -> None:
    def stop(*_: object) -> None:
        raise _Stopped

    old = signal.signal(signal.SIGTERM, stop)
    try:
        model.learn(steps, callback=watch, reset_num_timesteps=False, log_interval=1)
        watch.keep()
    except (_Stopped, KeyboardInterrupt):
        # The last checkpoint may be a minute old; the networks are whole only between updates.
        raise KeyboardInterrupt from None
    finally:
        signal.signal(signal.SIGTERM, old)


def _processes(job: Job, hyper: Hyper) -> SubprocVecEnv:
    def make() -> gymnasium.Env[Any, Any]:
        return DaggerWrapper(
            gymnasium.make(
                gymnasium.spec(tsbench.learn.envs.DRIVE_V0),
                city=OWN_CITY,
                split="train",
                types=job.types or None,
                observation=hyper.observation,
                hold=HOLD_TICKS,
                more=job.more or None,
            )
        )

    return SubprocVecEnv([make] * job.workers, start_method="forkserver")


def _model(job: Job, hyper: Hyper, environments: VecMonitor) -> PPO:
    policy, arguments = policy_of(job.planner)
    # As near to the rollout asked for as gives whole batches.
    batches = hyper.rollout // hyper.batch
    each = max(round(hyper.rollout / job.workers / batches), 1) * batches
    model = PPO(
        policy, environments,
        learning_rate=lambda left: hyper.rate * (_LAST_RATE + (1.0 - _LAST_RATE) * left),
        n_steps=each, batch_size=each * job.workers // batches, n_epochs=hyper.epochs,
        gamma=hyper.gamma, gae_lambda=hyper.trace, clip_range=hyper.clip, ent_coef=hyper.entropy,
        vf_coef=hyper.value, max_grad_norm=hyper.gradient, policy_kwargs=arguments,
        device=job.device, seed=job.seed,
    )  # fmt: skip
    model.set_logger(configure(str(job.out / "tensorboard"), ["tensorboard"]))
    return model


def _export(job: Job, hyper: Hyper, model: PPO, progress: RlProgress) -> Network:
    training = {
        "command": command_line(),
        **job.facts(),
        "steps": progress.steps,
        "minutes": round(progress.seconds / 60.0, 1),
        "sessions": progress.sessions,
        "types": list(job.types),
        "more": list(job.more),
        "workers": job.workers,
        "device": job.device,
        "hyper": asdict(hyper),
        "torch": torch.__version__,
    }
    draw_rl(job.out)
    return save_weights(job.planner, job.out, actor_tensors(job.planner, model.policy), training)
