"""Several environments at once, as `gymnasium.make_vec` asks for them: each in a process of its own."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import gymnasium
from gymnasium.vector import AsyncVectorEnv
from gymnasium.wrappers import TimeLimit

from tsbench.envs.drive import DriveEnv


def drive_in_processes(
    num_envs: int = 1, max_episode_steps: int | None = None, **options: Any
) -> AsyncVectorEnv:
    """libsumo has one simulation per process, so a vector of environments in one process could not drive."""
    return AsyncVectorEnv([partial(_one, max_episode_steps, options)] * num_envs, context="spawn")


def _one(steps: int | None, options: Mapping[str, Any]) -> gymnasium.Env[Any, Any]:
    env = DriveEnv(**options)
    return env if steps is None else TimeLimit(env, steps)
