"""`cruise`: a speed to drive at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tsbench.learn.envs.drive_env import DriveEnv
from tsbench.learn.envs.encoders import cruise
from tsbench.learn.rl.actions import accelerate, aim


def test_an_unchanging_number_keeps_a_speed() -> None:
    env = DriveEnv(split="dev", types="speed_limit", half="contrast", action="cruise")
    env.reset(options={"scenario": min(env._by_id)})
    first = env.episode.observation
    for _ in range(80):
        env.step(np.array([-0.36, 0.0], dtype=np.float32))
    last = env.episode.observation
    env.close()
    assert first.ego.speed > 10.0
    assert last.ego.speed == pytest.approx(8.0, abs=0.1)

    # It accelerates as the other actions can, steers as `aim`, and numbers beyond -1..1 are the nearest.
    assert cruise(1.0, 0.0, last).acceleration == accelerate(1.0)
    assert cruise(-1.0, 0.0, last).acceleration == accelerate(-1.0)
    assert cruise(7.0, 9.0, last) == cruise(1.0, 1.0, last)
    assert cruise(0.0, 0.5, last).steering == aim(0.0, 0.5, last).steering
    stands = replace(last, ego=replace(last.ego, speed=0.0))
    assert cruise(-1.0, 0.0, stands).acceleration == 0.0
