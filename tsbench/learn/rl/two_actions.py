"""What `ppo` and `carl` have in common: an encoder, a network of two actions, and actions that hold for 0.3 s.

Both drive as they learned to: by draws from their densities, not by mean or mode, which hesitate where the density
leans to neither side. The draws come from the scenario's seed, one pair for each decision.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from tsbench.geometry.polyline import Array
from tsbench.learn.rl.actions import HOLD_TICKS, aim
from tsbench.planners.base import Control, Observation, PlannerContext
from tsbench.planners.batching import Infer, Records

# What the networks answer: two numbers of -1..1.
ACTIONS = np.dtype([("action", np.float64, (2,))])
# What they are asked besides what is seen: which quantile of each density to answer with.
DRAW = ("draw", np.float64, (2,))
# More decisions than an episode has.
_DECISIONS = 1024


class LearnedPlanner(ABC):
    """A planner whose network decides every third tick; what that means for the vehicle is worked out at each.

    infer: answers (b,) records of `inputs` with (b,) records of `ACTIONS`, each as if it were alone, to the bit; None =
    a network of its own, with the weights below `folder` (None: tsbench's).
    """

    privileged = False
    sign_access = False
    follows_route = False
    inputs: ClassVar[np.dtype[Any]]

    def __init__(self, infer: Infer | None = None, folder: Path | None = None) -> None:
        self.infer = self.network("cpu", folder) if infer is None else infer
        self._action: tuple[float, float] = (0.0, 0.0)
        self._draws: Array

    @staticmethod
    @abstractmethod
    def network(device: str, folder: Path | None = None) -> Infer:
        """The network on a device; InputError where the weights below `folder` are not its own."""

    def reset(self, context: PlannerContext) -> None:
        self._action = (0.0, 0.0)
        self._draws = np.random.default_rng(np.random.SeedSequence(context.seed)).random((_DECISIONS, 2))

    def act(self, observation: Observation) -> Control:
        if observation.step % HOLD_TICKS == 0:
            first, second = self.infer(self.encode(observation))["action"][0].tolist()
            self._action = first, second
        return aim(*self._action, observation)

    def act_batch(self, observations: Sequence[Observation]) -> list[Control]:
        """A fresh decision for each of several observations on the present roads; each as it would be alone."""
        actions = self.infer(np.concatenate([self.encode(o) for o in observations]))["action"].tolist()
        return [aim(first, second, o) for (first, second), o in zip(actions, observations, strict=True)]

    def encode(self, observation: Observation) -> Records:
        """(1,) record of `inputs`."""
        record: Records = np.empty(1, dtype=self.inputs)
        record["draw"][0] = self._draws[observation.step // HOLD_TICKS % _DECISIONS]
        self.fill(record, observation)
        return record

    @abstractmethod
    def fill(self, record: Records, observation: Observation) -> None: ...
