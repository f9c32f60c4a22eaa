"""A planner whose "network" is a formula: the speed to drive at, from the ego's own."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from tsbench import Control, Observation, PlannerContext, pursue_route


class Steady:
    inputs = np.dtype([("speed", np.float32)])
    served_on = ("cuda",)

    def __init__(self, infer=None) -> None:
        self._infer = infer or self.network("cpu")

    @staticmethod
    def network(device: str):
        with Path(os.environ["DEVICES_LOG"]).open("a") as log:
            log.write(f"{device}\n")
        if device == os.environ.get("NO_DEVICE"):
            raise RuntimeError("no such device")
        return lambda records: 8.0 - records["speed"].astype(float)

    def reset(self, context: PlannerContext) -> None:
        pass

    def act(self, o: Observation) -> Control:
        return Control(float(self._infer(np.array([(o.ego.speed,)], self.inputs))[0]), pursue_route(o))
