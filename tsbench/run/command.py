"""From what a planner returned to a command for the vehicle, checked before anything else sees it."""

from __future__ import annotations

import math

from tsbench.errors import PlannerOutputError
from tsbench.planners.base import Control, Trajectory
from tsbench.sim.ego import Motion, check_trajectory, track


def to_command(output: object, motion: Motion) -> tuple[float, float]:
    """(acceleration, steering) of a planner's output. Raises PlannerOutputError with what is wrong."""
    if isinstance(output, Control):
        try:
            acceleration, steering = float(output.acceleration), float(output.steering)
        except (TypeError, ValueError):
            raise PlannerOutputError(
                f"Control holds {type(output.acceleration).__name__} and {type(output.steering).__name__}, "
                "expected two numbers"
            ) from None
        if not (math.isfinite(acceleration) and math.isfinite(steering)):
            raise PlannerOutputError(
                f"Control is not finite: acceleration {acceleration}, steering {steering}"
            )
        return acceleration, steering
    if isinstance(output, Trajectory):
        try:
            check_trajectory(output.times, output.poses)
        except (AttributeError, TypeError) as error:
            raise PlannerOutputError(f"Trajectory must hold NumPy arrays of numbers ({error})") from None
        return track(motion, output.times, output.poses)
    raise PlannerOutputError(f"act returned {type(output).__name__}, expected Control or Trajectory")
