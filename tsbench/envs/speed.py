"""How fast the environment is on this machine: `python -m tsbench.envs.speed [vector|bev|objects] [steps]`.

Seconds are the process's own on the CPU, so that other work on the machine counts as little as may be. The ego follows
its route; episodes are drawn from the test split, their starts are told apart.
"""

from __future__ import annotations

import statistics
import sys
import time
from dataclasses import dataclass

import gymnasium
import numpy as np

from tsbench.envs import DRIVE

_BLOCK = 500


@dataclass(frozen=True, slots=True)
class Speed:
    """Steps per CPU second (median and best of blocks of 500 steps), and with starts; ms per start."""

    steps_per_s: float
    best_per_s: float
    with_starts_per_s: float
    start_ms: float


def measure(observation: str, steps: int) -> Speed:
    """Drive so many steps, rounded to whole blocks."""
    env = gymnasium.make(DRIVE, split="test", observation=observation)
    action = np.array([0.05, 0.0], dtype=np.float32)
    env.reset(seed=0)
    rates, starts, everything = [], [], 0.0
    for _ in range(max(steps // _BLOCK, 1)):
        spent = 0.0
        for _ in range(_BLOCK):
            began = time.process_time()
            _, _, terminated, truncated, _ = env.step(action)
            spent += time.process_time() - began
            if terminated or truncated:
                began = time.process_time()
                env.reset()
                starts.append(time.process_time() - began)
        rates.append(_BLOCK / spent)
        everything += spent
    env.close()
    total = len(rates) * _BLOCK
    return Speed(
        statistics.median(rates), max(rates), total / (everything + sum(starts)),
        1000.0 * statistics.mean(starts) if starts else 0.0,
    )  # fmt: skip


def main() -> None:
    """Print one line."""
    kind = sys.argv[1] if len(sys.argv) > 1 else "vector"
    speed = measure(kind, int(sys.argv[2]) if len(sys.argv) > 2 else 5000)
    print(
        f"{kind}: {speed.steps_per_s:.0f} steps/s of CPU time (best block {speed.best_per_s:.0f}), "
        f"{speed.with_starts_per_s:.0f} with episode starts of {speed.start_ms:.0f} ms"
    )


if __name__ == "__main__":
    main()
