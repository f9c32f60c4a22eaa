"""tsbench: does a self-driving planner obey the traffic sign in front of it, and still arrive?

The names below are what a planner of one's own needs, and what runs planners from Python. They are imported when they
are used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tsbench.api.evaluate import evaluate as evaluate
    from tsbench.api.run import Run as Run
    from tsbench.api.run import load_run as load_run
    from tsbench.api.scenarios import load_scenarios as load_scenarios
    from tsbench.planners.base import Control as Control
    from tsbench.planners.base import Observation as Observation
    from tsbench.planners.base import Planner as Planner
    from tsbench.planners.base import PlannerContext as PlannerContext
    from tsbench.planners.base import Trajectory as Trajectory
    from tsbench.planners.common.pure_pursuit import pursue_route as pursue_route
    from tsbench.planners.helpers import RoadAhead as RoadAhead
    from tsbench.planners.helpers import sign_ahead as sign_ahead

__version__ = "0.1.0"

_PUBLIC = {
    "Control": "tsbench.planners.base",
    "Observation": "tsbench.planners.base",
    "Planner": "tsbench.planners.base",
    "PlannerContext": "tsbench.planners.base",
    "RoadAhead": "tsbench.planners.helpers",
    "Run": "tsbench.api.run",
    "Trajectory": "tsbench.planners.base",
    "evaluate": "tsbench.api.evaluate",
    "load_run": "tsbench.api.run",
    "load_scenarios": "tsbench.api.scenarios",
    "pursue_route": "tsbench.planners.common.pure_pursuit",
    "sign_ahead": "tsbench.planners.helpers",
}
__all__ = [
    "Control",
    "Observation",
    "Planner",
    "PlannerContext",
    "RoadAhead",
    "Run",
    "Trajectory",
    "__version__",
    "evaluate",
    "load_run",
    "load_scenarios",
    "pursue_route",
    "sign_ahead",
]


def __getattr__(name: str) -> object:
    if name in _PUBLIC:
        return getattr(importlib.import_module(_PUBLIC[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
