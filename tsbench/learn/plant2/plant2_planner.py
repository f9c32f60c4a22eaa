"""`plant2`, blind to signs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from tsbench.geometry.polyline import Array
from tsbench.learn.plant2.engine import Plant2Engine
from tsbench.learn.plant2.layout import RANGE_M, TOKENS, Record, Records, size_of
from tsbench.learn.plant2.tokens import Tokeniser, to_frame
from tsbench.planners.base import Control, Observation, PlannerContext
from tsbench.planners.batching import Infer, check_device
from tsbench.planners.weights import fitted, network
from tsbench.sim.ego import pursue
from tsbench.sim.world import EgoState


@dataclass(frozen=True, slots=True)
class Gains:
    """speed_p (1/s), speed_d (-): on speed and acceleration; yaw_d (s): on the yaw rate that the path does not ask for.

    ahead_s, ahead_m: where on the path is steered for. most, least: m/s2. halt: a slower target (m/s) is a halt.
    """

    speed_p: float = 1.5
    speed_d: float = 0.1
    yaw_d: float = 0.02
    ahead_s: float = 0.4
    ahead_m: float = 2.0
    most: float = 2.5
    least: float = -6.0
    halt: float = 0.4


def control(path: Array, speed: float, ego: EgoState, gains: Gains, driven: float = 0.0) -> Control:
    """The command for a path ((k, 2) m in the ego's frame, one point each metre) and a target speed (m/s).

    driven: metres since the place that the path begins at. PD control on path and speed, in m, s, m/s and rad. There is
    no integral part: the vehicle does exactly what the command says, and without memory the plan and the ego's state
    alone give the command.
    """
    target_speed = 0.0 if speed < gains.halt else speed
    acceleration = gains.speed_p * (target_speed - ego.speed) - gains.speed_d * ego.acceleration
    ahead = max(gains.ahead_m, gains.ahead_s * ego.speed)
    place = min(driven + ahead, float(len(path))) - 1.0
    k = min(int(place), len(path) - 2)
    share = place - k
    tx = float(path[k, 0] + share * (path[k + 1, 0] - path[k, 0]))
    ty = float(path[k, 1] + share * (path[k + 1, 1] - path[k, 1]))
    steering = pursue(0.0, 0.0, 0.0, tx, ty) if math.hypot(tx, ty) > 0.5 else 0.0
    asked = 2.0 * math.sin(math.atan2(ty, max(tx, 0.1))) / max(math.hypot(tx, ty), 1.0) * ego.speed
    steering -= gains.yaw_d * (ego.yaw_rate - asked)
    return Control(min(max(acceleration, gains.least), gains.most), steering)


# Ticks that a plan is followed.
HOLD_TICKS = 2


class Plant2:
    """The planner. Its network plans every second tick; each tick follows the last plan from where the ego is.

    infer: answers its records (None: its network on the CPU); folder: of that network's weights (None: tsbench's).
    """

    privileged = False
    sign_access = False
    weights: ClassVar[str] = "plant2"
    inputs: ClassVar[np.dtype[Any]] = TOKENS
    side_m: ClassVar[float] = RANGE_M
    served_on: ClassVar[tuple[str, ...]] = ("cuda",)

    def __init__(self, infer: Infer | None = None, folder: Path | None = None) -> None:
        self.infer = self.network("cpu", folder) if infer is None else infer
        self._gains = Gains()
        self._tokeniser: Tokeniser | None = None
        self._plan: Record | None = None
        self._since: EgoState

    @classmethod
    def network(cls, device: str, folder: Path | None = None) -> Infer:
        """Its network with the weights below `folder`: by the engine on a CPU, else by torch; errors of `fitted`."""
        size = size_of(network(cls.weights, folder))
        if device == "cpu":
            return fitted(cls.weights, folder, lambda weights: Plant2Engine(size, weights))
        from tsbench.learn.plant2.plant2_network import inference, network_of

        check_device(device)
        return inference(fitted(cls.weights, folder, lambda weights: network_of(size, weights)), device)

    def reset(self, context: PlannerContext) -> None:
        """Start an episode; what is drawn of a network of roads is kept for the next episode on it."""
        self._plan = None
        if self._tokeniser is None or self._tokeniser.network is not context.network:
            self._tokeniser = Tokeniser(context.network, self.side_m)

    def act(self, observation: Observation) -> Control:
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
        assert self._tokeniser is not None, "act before reset"
        return self._tokeniser.tokens(observation)

    def target_speed(self, plan: Record) -> float:
        return float(plan["speed"])

    def _decide(self, observation: Observation, plan: Record) -> Control:
        return control(plan["path"], self.target_speed(plan), observation.ego, self._gains)
