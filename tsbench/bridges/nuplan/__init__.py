"""nuPlan's planner protocol, spoken to planners that were written for it, with or without nuplan-devkit.

Names of its classes (`StateSE2`, `TrackedObjectType`) are here, too: its own where it is importable, else stand-ins.
"""

from typing import Any

from tsbench.bridges.nuplan.nuplan_planner import NuPlanPlanner, adapted, kit

__all__ = ["NuPlanPlanner", "adapted"]


def __getattr__(name: str) -> Any:
    if not name[:1].isupper():
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(kit(), name)
