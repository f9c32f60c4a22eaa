"""From what a planner returned to a command for the vehicle, checked before anything else sees it."""

from __future__ import annotations

import math

from tsbench.errors import PlannerOutputError
from tsbench.maps.network import RoadNetwork
from tsbench.planners.base import Control, Trajectory
from tsbench.sim.ego import Motion, check_trajectory, track

Command = tuple[float, float]


def to_command(output: object, motion: Motion, network: RoadNetwork) -> tuple[Command, tuple[str, ...]]:
    """((acceleration, steering), intent) of a planner's output. Raises PlannerOutputError with what is wrong."""
    if isinstance(output, Control):
        return _numbers(output), _intent(output.intent, network)
    if isinstance(output, Trajectory):
        try:
            check_trajectory(output.times, output.poses)
        except (AttributeError, TypeError) as error:
            raise PlannerOutputError(f"Trajectory must hold NumPy arrays of numbers ({error})") from None
        return track(motion, output.times, output.poses), _intent(output.intent, network)
    raise PlannerOutputError(f"act returned {type(output).__name__}, expected Control or Trajectory")


def _numbers(control: Control) -> Command:
    try:
        acceleration, steering = float(control.acceleration), float(control.steering)
    except (TypeError, ValueError):
        raise PlannerOutputError(
            f"Control holds {type(control.acceleration).__name__} and {type(control.steering).__name__}, "
            "expected two numbers"
        ) from None
    if not (math.isfinite(acceleration) and math.isfinite(steering)):
        raise PlannerOutputError(f"Control is not finite: acceleration {acceleration}, steering {steering}")
    return acceleration, steering


def _intent(edges: object, network: RoadNetwork) -> tuple[str, ...]:
    if not isinstance(edges, tuple):
        raise PlannerOutputError(f"intent is {type(edges).__name__}, expected a tuple of edge ids")
    for edge in edges:
        if not isinstance(edge, str) or edge not in network.edges:
            raise PlannerOutputError(f"intent names edge {edge!r}, which is not in the network")
    return edges
