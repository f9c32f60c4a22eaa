"""`plant2-ft` without what is written by hand beside its network, to see what that is worth. Not registered.

`tsbench run --planner tsbench.planners.plant2.ablations:WithoutHalts`
"""

from __future__ import annotations

import math
from typing import ClassVar

from tsbench.planners.base import Observation
from tsbench.planners.plant2.planner_ft import Plant2Ft, StopPolicy
from tsbench.planners.plant2.signs import SignMemory


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
