"""`tsbench train ppo|carl`: PPO of Stable-Baselines3 on `tsbench/Drive-v0`, one process per simulation."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gymnasium
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import SubprocVecEnv, VecMonitor

import tsbench.learn.envs
from tsbench.core.errors import SimulationError
from tsbench.learn.checkpoint import command_line, keep_freed_memory, prepare
from tsbench.learn.learning_curve import draw_rl
from tsbench.learn.rl.actions import HOLD_TICKS
from tsbench.learn.rl.dagger import DaggerWrapper, warm_up
from tsbench.learn.rl.policy import actor_tensors, policy_of
from tsbench.learn.rl.ppo_config import HYPER, Hyper, Job
from tsbench.learn.rl.progress import ProgressCallback, RlProgress, load_progress, save_progress, session_seed
from tsbench.planners.weights import Network, save_weights

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
        "hyper": {name: getattr(hyper, name) for name in Hyper.__slots__},
        "torch": torch.__version__,
    }
    draw_rl(job.out)
    return save_weights(job.planner, job.out, actor_tensors(job.planner, model.policy), training)
