"""Stages follow each other by episodes, and the last one stays."""

from __future__ import annotations

import pytest

from tsbench.core.errors import InputError
from tsbench.learn.envs.drive_env import Curriculum, DriveEnv


def test_stages_follow_each_other() -> None:
    made = Curriculum(DriveEnv(split="dev"), [(2, {"half": "signed"}), (1, {"half": "contrast"})])
    halves = [made.reset(seed=k)[1]["half"] for k in range(5)]
    assert halves == ["signed"] * 2 + ["contrast"] * 3
    assert made.reset(options={"half": "signed"})[1]["half"] == "signed"
    made.close()
    with pytest.raises(InputError, match="at least one stage"):
        Curriculum(made.env, [])
