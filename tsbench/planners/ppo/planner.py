"""`ppo`: the vector through an MLP of 256 and 256 with tanh, whose Gaussian is drawn from. Sign-blind.

One row at a time, in NumPy: at this size a batch saves nothing, and so no result hangs on who shares a batch.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from scipy.special import ndtri

from tsbench.planners.base import Observation, PlannerContext
from tsbench.planners.batched import Infer, Records
from tsbench.planners.expert import Expert
from tsbench.planners.learned import ACTIONS, DRAW, LearnedPlanner
from tsbench.planners.led import Led
from tsbench.planners.ppo.vector import SIZE, VectorEncoder
from tsbench.planners.weights import load_weights

WEIGHTS = "ppo"
RECORD = np.dtype([("vector", np.float32, (SIZE,)), DRAW])
_HIDDEN = ("hidden.0", "hidden.1")


class Ppo(LearnedPlanner):
    """The planner. folder: of the weights, as `tsbench train ppo --out` makes it; None: those of tsbench."""

    inputs: ClassVar[np.dtype[Any]] = RECORD

    def __init__(self, folder: Path | None = None) -> None:
        super().__init__(network(folder))
        self._encoder = VectorEncoder()

    def reset(self, context: PlannerContext) -> None:
        """Start an episode."""
        super().reset(context)
        self._encoder.reset(context)

    def fill(self, record: Records, observation: Observation) -> None:
        """Its `vector` (275,) float32."""
        record["vector"][0] = self._encoder.encode(observation)


def network(folder: Path | None = None) -> Infer:
    """The MLP with the weights below `folder`."""
    tensors = load_weights(WEIGHTS, folder)
    hidden = [(tensors[f"{name}.weight"], tensors[f"{name}.bias"]) for name in _HIDDEN]
    weight, bias = tensors["action.weight"], tensors["action.bias"]
    width = np.exp(tensors["action.log_std"].astype(np.float64))

    def infer(records: Records) -> Records:
        answers = np.empty(len(records), dtype=ACTIONS)
        for k, x in enumerate(records["vector"]):
            for w, b in hidden:
                x = np.tanh(w @ x + b)
            answers["action"][k] = weight @ x + bias + width * ndtri(records["draw"][k])
        return answers

    return infer


class PpoExpert(Expert):
    """`ppo-e`."""

    def __init__(self) -> None:
        super().__init__(Led(Ppo()))
