"""How fast the environment is on this machine: `python -m tsbench.envs.speed [vector|bev|objects|scene] [steps]`.

Seconds are the process's own on the CPU, so that other work on the machine counts as little as may be. The ego follows
its route; episodes are drawn from the test split, their starts are told apart.
"""

from __future__ import annotations

import statistics
import sys
import time

import gymnasium
import numpy as np

from tsbench.envs import DRIVE

BLOCK = 500


def measure(observation: str, steps: int) -> tuple[list[float], list[float]]:
    """CPU seconds of each block of 500 steps, as many as `steps` are, and of each start of an episode in them."""
    env = gymnasium.make(DRIVE, split="test", observation=observation)
    action = np.array([0.05, 0.0], dtype=np.float32)
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
