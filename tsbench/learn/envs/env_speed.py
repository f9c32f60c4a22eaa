"""How fast the environment is here, for `tsbench bench --env`.

Seconds are the processes' own on the CPU, so that other work on the machine counts as little as may be. The ego follows
its route; episodes are drawn from the test split.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Iterable
from pathlib import Path

import gymnasium
import numpy as np

from tsbench.learn.envs import DRIVE
from tsbench.learn.envs.drive_env import drive_in_processes

BLOCK = 500
ONWARD = (0.05, 0.0)
# Environments at once, and steps of each before time is taken: what only the first steps need has been made by then.
_SEVERAL, _FIRST = 2, 20


def rates_of(observation: str, steps: int) -> tuple[float, float]:
    """Steps per second of CPU time, of the median block, and over all with the starts of episodes."""
    env = gymnasium.make(DRIVE, split="test", observation=observation, action="aim")
    action = np.array(ONWARD, dtype=np.float32)
    env.reset(seed=0)
    blocks, starts = [], 0.0
    for _ in range(max(steps // BLOCK, 1)):
        spent = 0.0
        for _ in range(BLOCK):
            began = time.process_time()
            _, _, terminated, truncated, _ = env.step(action)
            spent += time.process_time() - began
            if terminated or truncated:
                began = time.process_time()
                env.reset()
                starts += time.process_time() - began
        blocks.append(spent)
    env.close()
    return BLOCK / statistics.median(blocks), len(blocks) * BLOCK / (sum(blocks) + starts)


def vectorised(observation: str, steps: int) -> float:
    """Steps per second of CPU time of two environments in `AsyncVectorEnv`, this process's and theirs together.

    Starts of episodes and the way from process to process count.
    """
    envs = drive_in_processes(_SEVERAL, split="test", observation=observation, action="aim")
    action = np.tile(np.array(ONWARD, dtype=np.float32), (_SEVERAL, 1))
    envs.reset(seed=0)
    for _ in range(_FIRST):
        envs.step(action)
    pids = [process.pid for process in envs.processes]
    began, each = _cpu_seconds(pids), max(steps // _SEVERAL, 1)
    for _ in range(each):
        envs.step(action)
    spent = _cpu_seconds(pids) - began
    envs.close()
    return each * _SEVERAL / spent


def _cpu_seconds(pids: Iterable[int | None]) -> float:
    """CPU time of this process and of others, which Linux counts in hundredths of a second."""
    ticks = 0
    for pid in pids:
        # Behind the name, which may hold anything and ends with the last bracket: user and system time.
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])
    return time.process_time() + ticks / os.sysconf("SC_CLK_TCK")
