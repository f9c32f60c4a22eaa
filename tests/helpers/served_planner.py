"""A planner whose "network" is a formula: the speed to drive at, from the ego's own."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from tsbench import Control, Observation, PlannerContext, pursue_route


class Steady:
    inputs = np.dtype([("state", np.float32, (2,))])
    outputs = np.dtype([("acceleration", np.float64)])
    served_on = ("cpu",)

    def __init__(self, infer=None) -> None:
        self._infer = infer or self.network("cpu")
        # Who made it where, for the test to read.
        with Path(os.environ["SERVED_LOG"]).open("a") as log:
            log.write(f"{'own' if infer is None else 'served'}\n")

    @staticmethod
    def network(device: str):
        if os.environ.get("SERVED_BROKEN"):
            raise RuntimeError("no such layer")
        asked = 0

        def infer(records):
            nonlocal asked
            asked += len(records)
            if os.environ.get("SERVED_DIES") and asked > 200:
                os.kill(os.getpid(), 9)
            if (records["state"][:, 1] < 0.0).any():
                raise ArithmeticError("before the beginning")
            answers = np.empty(len(records), dtype=Steady.outputs)
            answers["acceleration"] = 8.0 - records["state"][:, 0].astype(float)
            return answers

        return infer

    def reset(self, context: PlannerContext) -> None:
        pass

    def act(self, o: Observation) -> Control:
        record = np.zeros(1, dtype=self.inputs)
        record["state"][0] = o.ego.speed, o.time
        return Control(float(self._infer(record)["acceleration"][0]), pursue_route(o))
