"""Equal seeds give equal roll-outs, byte for byte, in processes of either kind."""

from __future__ import annotations

import hashlib
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv

STEPS, SEED = 25, 11


def make() -> gymnasium.Env[Any, Any]:
    return gymnasium.make("tsbench.envs:tsbench/Drive-v0", split="test")


def rolled_out(context: str) -> str:
    actions = np.random.default_rng(SEED).uniform(-0.4, 0.4, (STEPS, 2, 2)).astype(np.float32)
    envs = AsyncVectorEnv([make, make], context=context)
    digest = hashlib.sha256(np.asarray(envs.reset(seed=SEED)[0]).tobytes())
    for action in actions:
        seen, rewards, terminated, _, _ = envs.step(action)
        assert not terminated.any()
        digest.update(np.asarray(seen).tobytes() + rewards.tobytes())
    envs.close()
    return digest.hexdigest()


@pytest.mark.slow
def test_equal_seeds_equal_bytes_under_spawn_and_forkserver() -> None:
    assert rolled_out("spawn") == rolled_out("forkserver")
