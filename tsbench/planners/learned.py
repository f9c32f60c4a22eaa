"""What `ppo` and `carl` have in common: an encoder, a network of two actions, and actions that hold for 0.3 s."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tsbench.geometry.polyline import Array
from tsbench.planners.base import Control, Observation, PlannerContext
from tsbench.planners.learned_actions import HOLD_TICKS, aim

Inputs = npt.NDArray[Any]


class LearnedPlanner(ABC):
    """A planner whose network decides every third tick; what that means for the vehicle is worked out at each."""

    privileged = False
    sign_access = False
    follows_route = False

    def __init__(self) -> None:
        self._action: tuple[float, float] = (0.0, 0.0)

    def reset(self, context: PlannerContext) -> None:  # noqa: ARG002
        """Start an episode."""
        self._action = (0.0, 0.0)

    def act(self, observation: Observation) -> Control:
        """One command for the next 0.1 s."""
        if observation.step % HOLD_TICKS == 0:
            first, second = self.infer(self.encode(observation))[0].tolist()
            self._action = first, second
        return aim(*self._action, observation)

    def act_batch(self, observations: Sequence[Observation]) -> list[Control]:
        """A fresh decision for each of several observations on the present network; each as it would be alone."""
        return self.decide(observations, np.concatenate([self.encode(o) for o in observations]))

    def decide(self, observations: Sequence[Observation], inputs: Inputs) -> list[Control]:
        """Fresh decisions from (b, …) inputs, of whatever episodes."""
        actions = self.infer(inputs).tolist()
        return [aim(first, second, o) for (first, second), o in zip(actions, observations, strict=True)]

    @abstractmethod
    def encode(self, observation: Observation) -> Inputs:
        """(1, …) of the network's inputs: all that an inference process needs to be sent."""

    @abstractmethod
    def infer(self, inputs: Inputs) -> Array:
        """(b, 2) actions in -1..1; a row does not hang on the others, to the bit."""
