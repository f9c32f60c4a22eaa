"""`ppo`: the vector through an MLP of 256 and 256 with tanh; the mean of its Gaussian is the action. Sign-blind.

One row at a time, in NumPy: at this size a batch saves nothing, and so no result hangs on who shares a batch.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tsbench.geometry.polyline import Array
from tsbench.planners.base import Observation, PlannerContext
from tsbench.planners.expert import Expert
from tsbench.planners.learned import Inputs, LearnedPlanner
from tsbench.planners.ppo.vector import VectorEncoder
from tsbench.planners.weights import load_weights

WEIGHTS = "ppo"
_HIDDEN = ("hidden.0", "hidden.1")


class Ppo(LearnedPlanner):
    """The planner."""

    def __init__(self, folder: Path | None = None) -> None:
        """`folder`: of the weights, as `tsbench train ppo --out` makes it; None for those that come with tsbench."""
        super().__init__()
        tensors = load_weights(WEIGHTS, folder)
        self._hidden = [(tensors[f"{name}.weight"], tensors[f"{name}.bias"]) for name in _HIDDEN]
        self._last = tensors["action.weight"], tensors["action.bias"]
        self._encoder = VectorEncoder()

    def reset(self, context: PlannerContext) -> None:
        """Start an episode."""
        super().reset(context)
        self._encoder.reset(context)

    def encode(self, observation: Observation) -> Inputs:
        """(1, 275) float32."""
        return self._encoder.encode(observation)[None]

    def infer(self, inputs: Inputs) -> Array:
        """(b, 2) means."""
        return np.array([self._mean(row) for row in inputs], dtype=np.float64).reshape(-1, 2)

    def _mean(self, x: Inputs) -> Inputs:
        for weight, bias in self._hidden:
            x = np.tanh(weight @ x + bias)
        weight, bias = self._last
        mean: Inputs = weight @ x + bias
        return mean


class PpoExpert(Expert):
    """`ppo-e`."""

    def __init__(self) -> None:
        super().__init__(Ppo())
