"""`plant2-blind`: `plant2-ft` that has learned with posts in place of plates. Source: docs/floor.md."""

from __future__ import annotations

from typing import ClassVar

from tsbench.planners.base import Control, Observation
from tsbench.planners.floor.blind import masked
from tsbench.planners.plant2.layout import Records
from tsbench.planners.plant2.planner_ft import Plant2Ft


class Plant2Blind(Plant2Ft):
    """The planner. It masks plates by itself before it looks, so it drives alike with and without `--mask-signs`."""

    sign_access = False
    floor = True
    weights: ClassVar[str] = "plant2-blind"

    def act(self, observation: Observation) -> Control:
        """As `Plant2Ft.act`, of what is seen without plates."""
        return super().act(masked(observation))

    def encode(self, observation: Observation) -> Records:
        """Masked here too: answers for several observations at once are asked for without `act`."""
        return super().encode(masked(observation))
