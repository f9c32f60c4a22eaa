"""tsbench: does a self-driving planner obey the traffic sign in front of it, and still arrive?

The names below are what a planner of one's own needs, and what runs planners from Python. They are imported when they
are used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tsbench.api.drive import Drive as Drive
    from tsbench.api.drive import drive as drive
    from tsbench.api.evaluate import evaluate as evaluate
    from tsbench.api.loaded_run import Run as Run
    from tsbench.api.loaded_run import load_run as load_run
    from tsbench.api.scenario_list import load_scenarios as load_scenarios
    from tsbench.planners.base import Control as Control
    from tsbench.planners.base import Planner as Planner
    from tsbench.planners.base import PlannerContext as PlannerContext
    from tsbench.planners.base import Trajectory as Trajectory
    from tsbench.planners.geometry import EGO as EGO
    from tsbench.planners.geometry import ActorHistory as ActorHistory
    from tsbench.planners.geometry import RouteLine as RouteLine
    from tsbench.planners.geometry import lane_bounds as lane_bounds
    from tsbench.planners.geometry import lane_polygon as lane_polygon
    from tsbench.planners.geometry import route_lanes as route_lanes
    from tsbench.planners.geometry import route_line as route_line
    from tsbench.planners.helpers import RoadAhead as RoadAhead
    from tsbench.planners.helpers import identified as identified
    from tsbench.planners.helpers import line_ahead as line_ahead
    from tsbench.planners.helpers import sign_ahead as sign_ahead
    from tsbench.planners.lane_change import pursue_route as pursue_route
    from tsbench.planners.observation import Observation as Observation

__version__ = "0.1.0"

_PUBLIC = {
    "ActorHistory": "tsbench.planners.geometry",
    "Control": "tsbench.planners.base",
    "Drive": "tsbench.api.drive",
    "EGO": "tsbench.planners.geometry",
    "Observation": "tsbench.planners.observation",
    "Planner": "tsbench.planners.base",
    "PlannerContext": "tsbench.planners.base",
    "RoadAhead": "tsbench.planners.helpers",
    "RouteLine": "tsbench.planners.geometry",
    "Run": "tsbench.api.loaded_run",
    "Trajectory": "tsbench.planners.base",
    "drive": "tsbench.api.drive",
    "evaluate": "tsbench.api.evaluate",
    "lane_bounds": "tsbench.planners.geometry",
    "lane_polygon": "tsbench.planners.geometry",
    "line_ahead": "tsbench.planners.helpers",
    "load_run": "tsbench.api.loaded_run",
    "load_scenarios": "tsbench.api.scenario_list",
    "pursue_route": "tsbench.planners.lane_change",
    "route_lanes": "tsbench.planners.geometry",
    "route_line": "tsbench.planners.geometry",
    "identified": "tsbench.planners.helpers",
    "sign_ahead": "tsbench.planners.helpers",
}
__all__ = ["__version__", *_PUBLIC]


def __getattr__(name: str) -> object:
    if name in _PUBLIC:
        return getattr(importlib.import_module(_PUBLIC[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
