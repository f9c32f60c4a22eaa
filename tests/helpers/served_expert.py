"""`plant2-e` as a planner whose network is served on a CPU."""

from __future__ import annotations

from tsbench.planners.plant2.planner import Plant2Expert


class ServedExpert(Plant2Expert):
    served_on = ("cpu",)
