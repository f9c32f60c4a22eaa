"""A curriculum: which scenarios an environment draws, by how many episodes it has begun."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium

from tsbench.core.errors import InputError


class Curriculum(gymnasium.Wrapper[Any, Any, Any, Any]):
    """stages: (episodes, options of `reset`) in order; the last stage holds for good, whatever its number."""

    def __init__(self, env: gymnasium.Env[Any, Any], stages: Sequence[tuple[int, Mapping[str, Any]]]) -> None:
        super().__init__(env)
        if not stages or any(episodes < 1 for episodes, _ in stages):
            raise InputError("curriculum: expected at least one stage, each of at least one episode")
        self._stages, self._begun = tuple(stages), 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """As the environment's; what is asked for here goes before what the stage asks for."""
        asked = {**self._stage(), **(options or {})}
        self._begun += 1
        return self.env.reset(seed=seed, options=asked)

    def _stage(self) -> Mapping[str, Any]:
        left = self._begun
        for episodes, options in self._stages[:-1]:
            if left < episodes:
                return options
            left -= episodes
        return self._stages[-1][1]
