"""nuPlan's planner protocol, spoken to planners that were written for it; nuplan-devkit itself is not needed."""

from tsbench.adapters.nuplan.nuplan_planner import NuPlanPlanner, PlannerInitialization, PlannerInput
from tsbench.adapters.nuplan.states import StateSE2, TimePoint, TrackedObjectType

__all__ = [
    "NuPlanPlanner",
    "PlannerInitialization",
    "PlannerInput",
    "StateSE2",
    "TimePoint",
    "TrackedObjectType",
]
