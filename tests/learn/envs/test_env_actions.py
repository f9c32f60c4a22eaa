"""Actions of the environment: `exit` leaves the navigation's way where it is asked to, `cruise` keeps a speed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import RenderCollection

from tsbench.core.errors import InputError
from tsbench.learn.envs import DRIVE, MAX_STEPS
from tsbench.learn.envs.drive_env import DriveEnv
from tsbench.learn.envs.view import SIZE_PX
from tsbench.learn.rl.actions import accelerate, aim, cruise
from tsbench.report.drawing.canvas import STYLE


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


def test_a_prohibited_turn_can_be_left_out(drive_env: Callable[..., DriveEnv]) -> None:
    env = drive_env(split="dev", types="no_turn_left", action="exit", half="signed")
    assert env.action_space.shape == (3,)
    scenario = min(env._by_id)
    ends = {}
    for turn in (0.0, -1 / 3):
        env.reset(options={"scenario": scenario})
        ends[turn] = drive(env, turn)
    assert not ends[0.0]["sign_compliant"]
    assert ends[-1 / 3]["sign_compliant"]
    assert ends[-1 / 3]["outcome"] == "arrived"


def test_with_the_navigations_own_turn_it_is_aim(drive_env: Callable[..., DriveEnv]) -> None:
    same = []
    for action in ("aim", "exit"):
        env = drive_env(split="dev", types="speed_limit", action=action, half="signed")
        env.reset(options={"scenario": min(env._by_id)})
        numbers = np.zeros(2 if action == "aim" else 3, dtype=np.float32)
        for _ in range(40):
            env.step(numbers)
        ego = env.episode.observation.ego
        same.append((ego.x, ego.y, ego.heading, ego.speed))
    assert same[0] == same[1]


def test_the_exits_are_from_right_to_left(drive_env: Callable[..., DriveEnv]) -> None:
    env = drive_env(split="dev", types="direction_straight", action="exit")
    env.reset(seed=0)
    o = env.episode.observation
    exits = env._act.exits(o.route.path.edges[0])
    assert o.route.path.edges[1] in exits
    turns = [env._act._turn(o.route.path.edges[0], onward) for onward in exits]
    assert turns == sorted(turns)
    assert len(exits) > 1


def test_an_unchanging_number_keeps_a_speed(drive_env: Callable[..., DriveEnv]) -> None:
    env = drive_env(split="dev", types="speed_limit", half="contrast", action="cruise")
    env.reset(options={"scenario": min(env._by_id)})
    first = env.episode.observation
    for _ in range(80):
        env.step(np.array([-0.36, 0.0], dtype=np.float32))
    last = env.episode.observation
    assert first.ego.speed > 10.0
    assert last.ego.speed == pytest.approx(8.0, abs=0.1)

    # It accelerates as the other actions can, steers as `aim`, and numbers beyond -1..1 are the nearest.
    assert cruise(1.0, 0.0, last).acceleration == accelerate(1.0)
    assert cruise(-1.0, 0.0, last).acceleration == accelerate(-1.0)
    assert cruise(7.0, 9.0, last) == cruise(1.0, 1.0, last)
    assert cruise(0.0, 0.5, last).steering == aim(0.0, 0.5, last).steering
    stands = replace(last, ego=replace(last.ego, speed=0.0))
    assert cruise(-1.0, 0.0, stands).acceleration == 0.0


ONWARD = np.array([0.2, 0.0], dtype=np.float32)


def test_the_ego_is_in_the_middle_and_the_road_goes_by(drive_env: Callable[..., DriveEnv]) -> None:
    env = drive_env(split="dev", types="speed_limit", render_mode="rgb_array")
    env.reset(options={"half": "signed"}, seed=0)
    first = env.render()
    assert first.shape == (SIZE_PX, SIZE_PX, 3)
    assert first.dtype == np.uint8
    middle = first[SIZE_PX // 2 - 4 : SIZE_PX // 2 + 5, SIZE_PX // 2 - 4 : SIZE_PX // 2 + 5].reshape(-1, 3)
    assert (middle == STYLE.ego).all(axis=1).mean() > 0.5
    for _ in range(10):
        env.step(ONWARD)
    assert (env.render() != first).mean() > 0.02


def test_wrappers_collect_its_frames() -> None:
    asked = {"split": "dev", "types": "detour_right", "action": "aim", "render_mode": "rgb_array"}
    env = RenderCollection(gymnasium.make(DRIVE, **asked))
    env.reset(seed=0)
    for _ in range(10):
        env.step(ONWARD)
    frames = env.render()
    assert len(frames) == 11
    assert all(frame.shape == (SIZE_PX, SIZE_PX, 3) for frame in frames)
    env.close()


def test_what_cannot_be_rendered_is_said(drive_env: Callable[..., DriveEnv]) -> None:
    with pytest.raises(InputError, match=r"render_mode 'ansi': expected rgb_array \| human"):
        DriveEnv(split="dev", render_mode="ansi")
    env = drive_env(split="dev")
    env.reset(seed=0)
    with pytest.raises(gymnasium.error.ResetNeeded, match="give render_mode"):
        env.render()


def test_without_a_screen_a_window_is_refused(
    monkeypatch: pytest.MonkeyPatch, drive_env: Callable[..., DriveEnv]
) -> None:
    monkeypatch.setattr("matplotlib.pyplot.get_backend", lambda: "agg")
    env = drive_env(split="dev", render_mode="human")
    with pytest.raises(InputError, match="take 'rgb_array'"):
        env.reset(seed=0)
