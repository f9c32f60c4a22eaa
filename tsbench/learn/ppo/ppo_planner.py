"""`ppo`: the vector through an MLP of 256 and 256 with tanh, whose Gaussian is drawn from. Sign-blind."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from tsbench.geometry.elementary import exp
from tsbench.learn.networks.fixed_point import Linear, Parameters, snap, tanh
from tsbench.learn.ppo.vector import SIZE, VectorEncoder
from tsbench.learn.rl.actions import DRAW, TWO_ACTIONS, LearnedPlanner, normal_quantile
from tsbench.planners.base import Observation, PlannerContext
from tsbench.planners.batching import Infer, Records
from tsbench.planners.weights import Tensors, fitted

WEIGHTS = "ppo"
RECORD = np.dtype([("vector", np.float32, (SIZE,)), DRAW])
# Inputs are about -1..1; what is beyond is cut, which bounds all that follows.
_MOST = 8.0


class Ppo(LearnedPlanner):
    """The planner."""

    inputs: ClassVar[np.dtype[Any]] = RECORD
    # A GPU gains nothing at this size.
    served_on: ClassVar[tuple[str, ...]] = ()

    def __init__(self, infer: Infer | None = None, folder: Path | None = None) -> None:
        super().__init__(infer, folder)
        self._encoder = VectorEncoder()

    @staticmethod
    def network(device: str, folder: Path | None = None) -> Infer:  # noqa: ARG004
        """The MLP, on the CPU whatever the device."""
        return fitted(WEIGHTS, folder, _network)

    def reset(self, context: PlannerContext) -> None:
        super().reset(context)
        self._encoder.reset(context)

    def fill(self, record: Records, observation: Observation) -> None:
        record["vector"][0] = self._encoder.encode(observation)


def _network(weights: Tensors) -> Infer:
    of = Parameters(weights)
    first = Linear(*of.linear("hidden.0"), bound=_MOST, snapped=None)
    second, action = (Linear(*of.linear(name), bound=1.0, snapped=None) for name in ("hidden.1", "action"))
    width = exp(of.take("action.log_std").astype(np.float64))
    of.end()
    if (first.weight.shape[1], action.weight.shape[0]) != (SIZE, len(width)):
        raise ValueError(f"{first.weight.shape[1]} inputs, {action.weight.shape[0]} actions")

    def infer(records: Records) -> Records:
        x = snap(np.clip(records["vector"].astype(np.float64), -_MOST, _MOST))
        mean = action(tanh(second(tanh(first(x)))))
        answers = np.empty(len(records), dtype=TWO_ACTIONS)
        answers["action"] = mean + width * normal_quantile(records["draw"])
        return answers

    return infer
