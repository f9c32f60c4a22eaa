"""`plant2`, blind to signs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from tsbench.planners.base import Control, Observation, PlannerContext
from tsbench.planners.common.batching import Infer
from tsbench.planners.experts.expert import Expert
from tsbench.planners.experts.obstacle_filter import ObstacleFilter
from tsbench.planners.plant2.control import Gains, control
from tsbench.planners.plant2.inference import load
from tsbench.planners.plant2.layout import PLAN, RANGE_M, TOKENS, Record, Records
from tsbench.planners.plant2.tokens import Tokeniser, to_frame
from tsbench.sim.world import EgoState

# Ticks that a plan is followed.
HOLD_TICKS = 2


class Plant2:
    """The planner. Its network plans every second tick; each tick follows the last plan from where the ego is.

    infer: who answers its records; folder: of the weights of its own network (None: tsbench's).
    """

    privileged = False
    sign_access = False
    weights: ClassVar[str] = "plant2"
    inputs: ClassVar[np.dtype[Any]] = TOKENS
    outputs: ClassVar[np.dtype[Any]] = PLAN
    side_m: ClassVar[float] = RANGE_M
    # On a CPU eight together cost half of eight alone, and the way to another process more than that.
    served_on: ClassVar[tuple[str, ...]] = ("cuda",)

    def __init__(self, infer: Infer | None = None, folder: Path | None = None) -> None:
        self.infer = load(self.weights, "cpu", folder) if infer is None else infer
        self._gains = Gains()
        self._tokeniser: Tokeniser | None = None
        self._plan: Record | None = None
        self._since: EgoState

    @classmethod
    def network(cls, device: str) -> Infer:
        """tsbench's own network on a device."""
        return load(cls.weights, device)

    def reset(self, context: PlannerContext) -> None:
        """Start an episode; what is drawn of a network of roads is kept for the next episode on it."""
        self._plan = None
        if self._tokeniser is None or self._tokeniser.network is not context.network:
            self._tokeniser = Tokeniser(context.network, self.side_m)

    def act(self, observation: Observation) -> Control:
        """One command for the next 0.1 s."""
        o = observation
        if self._plan is None or o.step % HOLD_TICKS == 0:
            self._plan, self._since = self.infer(self.encode(o))[0], o.ego
            return self._decide(o, self._plan)
        then, c, s = self._since, math.cos(self._since.heading), math.sin(self._since.heading)
        along, left = self._plan["path"].astype(np.float64).T
        points = np.column_stack((c * along - s * left + then.x, s * along + c * left + then.y))
        seen = to_frame(points, (o.ego.x, o.ego.y, o.ego.heading))
        driven = math.hypot(o.ego.x - then.x, o.ego.y - then.y)
        return control(seen, self.target_speed(self._plan), o.ego, self._gains, driven)

    def act_batch(self, observations: Sequence[Observation]) -> list[Control]:
        """A fresh plan's command for each of several observations on the present roads; as it would be alone."""
        plans = self.infer(np.concatenate([self.encode(o) for o in observations]))
        return [self._decide(o, plan) for o, plan in zip(observations, plans, strict=True)]

    def encode(self, observation: Observation) -> Records:
        """(1,) record of the network's inputs."""
        assert self._tokeniser is not None, "act before reset"
        return self._tokeniser.tokens(observation)

    def target_speed(self, plan: Record) -> float:
        """The speed of a plan, m/s."""
        return float(plan["speed"])

    def _decide(self, observation: Observation, plan: Record) -> Control:
        return control(plan["path"], self.target_speed(plan), observation.ego, self._gains)


class Plant2Expert(Expert):
    """`plant2-e`. Its base's network can be answered for from elsewhere, like `plant2`'s."""

    inputs: ClassVar[np.dtype[Any]] = Plant2.inputs
    outputs: ClassVar[np.dtype[Any]] = Plant2.outputs
    served_on: ClassVar[tuple[str, ...]] = Plant2.served_on

    def __init__(self, infer: Infer | None = None) -> None:
        super().__init__(ObstacleFilter(Plant2(infer)))

    @staticmethod
    def network(device: str) -> Infer:
        """The base's network on a device."""
        return Plant2.network(device)
