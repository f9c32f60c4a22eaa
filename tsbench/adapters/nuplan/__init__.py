"""nuPlan's planner protocol, spoken to planners that were written for it, with or without nuplan-devkit."""

from tsbench.adapters.nuplan.nuplan_planner import NuPlanPlanner, adapted
from tsbench.adapters.nuplan.states import (
    PlannerInitialization,
    PlannerInput,
    StateSE2,
    TimePoint,
    TrackedObjectType,
)

__all__ = [
    "NuPlanPlanner",
    "PlannerInitialization",
    "PlannerInput",
    "StateSE2",
    "TimePoint",
    "TrackedObjectType",
    "adapted",
]
