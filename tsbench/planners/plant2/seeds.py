"""`plant2-ft` trained a second time, with another seed, to see how much of its score is luck: `plant2-ft-seed1`.

`make train SEED=1` made its weights.
"""

from __future__ import annotations

from typing import ClassVar

from tsbench.planners.plant2.planner_ft import Plant2Ft


class SecondSeed(Plant2Ft):
    """The same network, lessons and hand-written parts; other draws everywhere."""

    weights: ClassVar[str] = "plant2-ft-seed1"
