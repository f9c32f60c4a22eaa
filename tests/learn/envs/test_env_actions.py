"""Actions of the environment: `exit` leaves the navigation's way where it is asked to, `cruise` keeps a speed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest

from tsbench.learn.envs import DRIVE, MAX_STEPS
from tsbench.learn.envs.drive_env import DriveEnv
from tsbench.learn.rl.actions import accelerate, aim, cruise


def drive(env: DriveEnv, turn: float) -> dict[str, Any]:
    """Rolls on slowly, with one wish for the first turn; then it follows the navigation."""
    first = env.episode.observation.ego.lane
    for _ in range(MAX_STEPS):
        ego = env.episode.observation.ego
        wish = turn if ego.lane == first else 0.0
        lane = env.episode.context.network.lanes[max(ego.lane, 0)]
        slow = lane.internal or lane.line.length - ego.s < 15.0
        pull = np.clip(0.5 * ((4.0 if slow else 11.0) - ego.speed), -1.0, 1.0)
        _, _, terminated, truncated, info = env.step(np.array([pull, 0.0, wish], dtype=np.float32))
        if terminated or truncated:
            return info
    raise AssertionError("the episode does not end")


def test_a_prohibited_turn_can_be_left_out() -> None:
    env = DriveEnv(split="dev", types="no_turn_left", action="exit", half="signed")
    assert env.action_space.shape == (3,)
    scenario = min(env._by_id)
    ends = {}
    for turn in (0.0, -1 / 3):
        env.reset(options={"scenario": scenario})
        ends[turn] = drive(env, turn)
    assert not ends[0.0]["sign_compliant"]
    assert ends[-1 / 3]["sign_compliant"]
    assert ends[-1 / 3]["outcome"] == "arrived"
    env.close()


def test_with_the_navigations_own_turn_it_is_aim() -> None:
    same = []
    for action in ("aim", "exit"):
        env = DriveEnv(split="dev", types="speed_limit", action=action, half="signed")
        env.reset(options={"scenario": min(env._by_id)})
        numbers = np.zeros(2 if action == "aim" else 3, dtype=np.float32)
        for _ in range(40):
            env.step(numbers)
        ego = env.episode.observation.ego
        same.append((ego.x, ego.y, ego.heading, ego.speed))
        env.close()
    assert same[0] == same[1]


def test_the_exits_are_from_right_to_left() -> None:
    env = DriveEnv(split="dev", types="direction_straight", action="exit")
    env.reset(seed=0)
    assert env._exit is not None
    o = env.episode.observation
    exits = env._exit.exits(o.route.path.edges[0])
    assert o.route.path.edges[1] in exits
    turns = [env._exit._turn(o.route.path.edges[0], onward) for onward in exits]
    assert turns == sorted(turns)
    assert len(exits) > 1
    env.close()


def test_the_registration_bounds_an_episode() -> None:
    spec = gymnasium.spec(DRIVE)
    assert spec.max_episode_steps == MAX_STEPS
    env = DriveEnv(split="dev")
    assert max(row.horizon for row in env._rows) < MAX_STEPS
    env.close()


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
