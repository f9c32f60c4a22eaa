"""Environments that are closed when their test ends."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from tsbench.learn.envs.drive_env import DriveEnv

MakeEnv = Callable[..., DriveEnv]


@pytest.fixture
def drive_env() -> Iterator[MakeEnv]:
    """Makes environments, each with options of its own."""
    made: list[DriveEnv] = []

    def make(**options: object) -> DriveEnv:
        made.append(DriveEnv(**options))  # type: ignore[arg-type]
        return made[-1]

    yield make
    for env in made:
        env.close()
