"""A planner with 200 MB of weights, to measure what its size costs: all are used for each answer."""

from __future__ import annotations

from typing import Final

import torch

import tsbench

_WIDTH: Final = 7071


class Heavy:
    """Keeps to its lane slowly; the network's answer changes it by nothing that matters."""

    def __init__(self) -> None:
        made = torch.Generator().manual_seed(1)
        self._weights = torch.rand((_WIDTH, _WIDTH), generator=made) / _WIDTH
        self._state = torch.ones(_WIDTH)

    def reset(self, context: tsbench.PlannerContext) -> None:
        pass

    def act(self, observation: tsbench.Observation) -> tsbench.Control:
        self._state = self._weights @ self._state
        change = 1e-6 * float(self._state.mean())
        return tsbench.Control(max(-1.0, 5.0 - observation.ego.speed) * 0.5 + change, tsbench.pursue_route(observation))
