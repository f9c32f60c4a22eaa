"""How fast the environment is here: `python -m tsbench.learn.envs.env_speed [vector|bev|objects|scene|plates] [steps]`.

Seconds are the processes' own on the CPU, so that other work on the machine counts as little as may be. The ego follows
its route; episodes are drawn from the test split, their starts are told apart, but where environments are several.
"""

from __future__ import annotations

import os
import statistics
import sys
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


def measure(observation: str, steps: int) -> tuple[list[float], list[float]]:
    """CPU seconds of each block of 500 steps, as many as `steps` are, and of each start of an episode in them."""
    env = gymnasium.make(DRIVE, split="test", observation=observation, action="aim")
    action = np.array(ONWARD, dtype=np.float32)
    env.reset(seed=0)
    blocks, starts = [], []
    for _ in range(max(steps // BLOCK, 1)):
        spent = 0.0
        for _ in range(BLOCK):
            began = time.process_time()
            _, _, terminated, truncated, _ = env.step(action)
            spent += time.process_time() - began
            if terminated or truncated:
                began = time.process_time()
                env.reset()
                starts.append(time.process_time() - began)
        blocks.append(spent)
    env.close()
    return blocks, starts


def rates_of(observation: str, steps: int) -> tuple[float, float]:
    """Steps per second of CPU time: the median block's, and over all blocks and the starts of episodes in them."""
    blocks, starts = measure(observation, steps)
    return BLOCK / statistics.median(blocks), len(blocks) * BLOCK / (sum(blocks) + sum(starts))


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


def main() -> None:
    kind = sys.argv[1] if len(sys.argv) > 1 else "vector"
    blocks, starts = measure(kind, int(sys.argv[2]) if len(sys.argv) > 2 else 5000)
    rates = [BLOCK / seconds for seconds in blocks]
    print(
        f"{kind}: {statistics.median(rates):.0f} steps/s of CPU time (best block {max(rates):.0f}), "
        f"{len(blocks) * BLOCK / (sum(blocks) + sum(starts)):.0f} with episode starts of "
        f"{1000.0 * statistics.mean(starts) if starts else 0.0:.0f} ms"
    )


if __name__ == "__main__":
    main()
