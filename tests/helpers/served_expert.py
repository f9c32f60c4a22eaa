"""`plant2` as a planner whose network is served on a CPU."""

from __future__ import annotations

from tsbench.planners.plant2.planner import Plant2


class Served(Plant2):
    served_on = ("cpu",)
