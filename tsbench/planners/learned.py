"""What `ppo` and `carl` have in common: an encoder, a network of two actions, and actions that hold for 0.3 s."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from tsbench.planners.base import Control, Observation, PlannerContext
from tsbench.planners.batched import Infer, Records
from tsbench.planners.learned_actions import HOLD_TICKS, aim

# What the networks answer: two numbers of -1..1.
ACTIONS = np.dtype([("action", np.float64, (2,))])


class LearnedPlanner(ABC):
    """A planner whose network decides every third tick; what that means for the vehicle is worked out at each.

    infer: answers (b,) records of `encode` with (b,) records of `ACTIONS`, each as if it were alone, to the bit.
    """

    privileged = False
    sign_access = False
    follows_route = False
    outputs: ClassVar[np.dtype[Any]] = ACTIONS

    def __init__(self, infer: Infer) -> None:
        self.infer = infer
        self._action: tuple[float, float] = (0.0, 0.0)

    def reset(self, context: PlannerContext) -> None:  # noqa: ARG002
        """Start an episode."""
        self._action = (0.0, 0.0)

    def act(self, observation: Observation) -> Control:
        """One command for the next 0.1 s."""
        if observation.step % HOLD_TICKS == 0:
            first, second = self.infer(self.encode(observation))["action"][0].tolist()
            self._action = first, second
        return aim(*self._action, observation)

    def act_batch(self, observations: Sequence[Observation]) -> list[Control]:
        """A fresh decision for each of several observations on the present roads; each as it would be alone."""
        actions = self.infer(np.concatenate([self.encode(o) for o in observations]))["action"].tolist()
        return [aim(first, second, o) for (first, second), o in zip(actions, observations, strict=True)]

    @abstractmethod
    def encode(self, observation: Observation) -> Records:
        """(1,) record of the network's inputs."""
