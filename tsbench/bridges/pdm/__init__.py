"""A proposal planner after PDM-Closed (Dauner et al., CoRL 2023), written against nuPlan's protocol. Sign-blind.

Reimplemented from the paper's description; no line of its code is here. It is told what any nuPlan planner is told and
nothing of tsbench; `Pdm` is the class that `--planner` names.
"""

from typing import Any, ClassVar

from tsbench.bridges.nuplan import NuPlanPlanner, states
from tsbench.bridges.pdm.pdm_planner import PdmPlanner


class Pdm(NuPlanPlanner):
    """`tsbench.bridges.pdm:Pdm`: asked every second tick."""

    sign_access = False
    make = staticmethod(PdmPlanner)
    every: ClassVar[int] = 2
    # The same bytes whether or not nuplan-devkit is there.
    kit: ClassVar[Any] = states


__all__ = ["Pdm", "PdmPlanner"]
