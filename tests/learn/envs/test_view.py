"""What `render` shows, and who may ask for it."""

from __future__ import annotations

from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import RecordVideo, RenderCollection

from tsbench.core.errors import InputError
from tsbench.learn.envs import DRIVE
from tsbench.learn.envs.drive_env import DriveEnv
from tsbench.learn.envs.view import SIZE_PX
from tsbench.report.drawing.canvas import STYLE

ONWARD = np.array([0.2, 0.0], dtype=np.float32)


def test_the_ego_is_in_the_middle_and_the_road_goes_by() -> None:
    env = DriveEnv(split="dev", types="speed_limit", render_mode="rgb_array")
    env.reset(options={"half": "signed"}, seed=0)
    first = env.render()
    assert first.shape == (SIZE_PX, SIZE_PX, 3)
    assert first.dtype == np.uint8
    middle = first[SIZE_PX // 2 - 4 : SIZE_PX // 2 + 5, SIZE_PX // 2 - 4 : SIZE_PX // 2 + 5].reshape(-1, 3)
    assert (middle == STYLE.ego).all(axis=1).mean() > 0.5
    for _ in range(10):
        env.step(ONWARD)
    assert (env.render() != first).mean() > 0.02
    env.close()


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


def test_record_video_films_an_episode(tmp_path: Path) -> None:
    pytest.importorskip("moviepy", reason="Gymnasium's RecordVideo needs the extra `record` (moviepy)")
    from imageio_ffmpeg import count_frames_and_secs

    asked = {"split": "dev", "types": "speed_limit", "action": "aim", "render_mode": "rgb_array"}
    env = RecordVideo(gymnasium.make(DRIVE, **asked), str(tmp_path), episode_trigger=lambda _: True)
    env.reset(seed=0)
    for _ in range(20):
        env.step(ONWARD)
    env.close()
    (film,) = tmp_path.glob("*.mp4")
    frames, seconds = count_frames_and_secs(str(film))
    assert frames == 21
    assert seconds == pytest.approx(2.1, abs=0.11)


def test_what_cannot_be_rendered_is_said() -> None:
    with pytest.raises(InputError, match=r"render_mode 'ansi': expected rgb_array \| human"):
        DriveEnv(split="dev", render_mode="ansi")
    env = DriveEnv(split="dev")
    env.reset(seed=0)
    with pytest.raises(gymnasium.error.ResetNeeded, match="give render_mode"):
        env.render()
    env.close()


def test_without_a_screen_a_window_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("matplotlib.pyplot.get_backend", lambda: "agg")
    env = DriveEnv(split="dev", render_mode="human")
    with pytest.raises(InputError, match="take 'rgb_array'"):
        env.reset(seed=0)
    env.close()
