"""`plant2-ft` varied for experiments: trained with another seed, or without its hand-written parts.

The second seed is registered as `plant2-ft-seed1`; `make train SEED=1` made its weights. The others are named by their
place: `tsbench run --planner tsbench.learn.plant2.ablations:WithoutHalts`.
"""

from __future__ import annotations

import math
from typing import ClassVar

from tsbench.learn.plant2.plant2_planner import Plant2Ft, StopPolicy
from tsbench.learn.plant2.sign_tokens import SignMemory
from tsbench.planners.observation import Observation


class SecondSeed(Plant2Ft):
    """The same network, lessons and hand-written parts; other draws everywhere."""

    weights: ClassVar[str] = "plant2-ft-seed1"


class WithoutHalts(Plant2Ft):
    """It drives at the mean of its network's speeds: no share decides that it stands, and no stop is held or braked."""

    def __init__(self) -> None:
        super().__init__(stop_policy=StopPolicy(share=math.inf))


class InSight(SignMemory):
    """Plates hold as long as they are seen; whether the ego has stood is not remembered."""

    def update(self, o: Observation) -> None:
        self.own, self.other = None, None
        super().update(o)
        self._stood.clear()


class WithoutMemory(Plant2Ft):
    """A plate that is out of sight is forgotten, and so is a stop."""

    memory: ClassVar[type[SignMemory]] = InSight
