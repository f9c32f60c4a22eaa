"""Commands as messages, both ways."""

from __future__ import annotations

from typing import Any

import numpy as np

from tsbench.board.isolation import protocol
from tsbench.board.isolation.protocol import ProtocolError
from tsbench.core.errors import PlannerOutputError, cause_of
from tsbench.core.text import written_out
from tsbench.planners.base import Control, Trajectory
from tsbench.sim.ego import MAX_TRAJECTORY_POSES


def command_message(output: object) -> bytes:
    """What a planner returned, or that it is no command."""
    try:
        if isinstance(output, Control):
            # A number of the planner's own making may raise what it likes.
            numbers = (_number(output.acceleration), _number(output.steering))
            plan = None if output.plan is None else _floats("Control.plan", output.plan, 2)
            return protocol.frame(protocol.ControlMessage(*numbers, _intent(output.intent), plan))
        if isinstance(output, Trajectory):
            times, poses = output.times, output.poses
            return protocol.frame(
                protocol.TrajectoryMessage(
                    _floats("Trajectory.times", times, 1), _floats("Trajectory.poses", poses, 3), _intent(output.intent)
                )
            )
    except KeyboardInterrupt:
        raise
    except BaseException as problem:
        reason = f"{type(output).__name__} cannot be read ({cause_of(problem)})"
    else:
        reason = f"act returned {type(output).__name__}, expected Control or Trajectory"
    return protocol.frame(protocol.InvalidMessage(written_out(reason)[:500]))


def read_command(answer: protocol.Answer) -> Control | Trajectory:
    """The command of a message. Raises PlannerOutputError or ProtocolError."""
    if isinstance(answer, protocol.ControlMessage):
        plan = None if answer.plan is None else answer.plan.array()
        return Control(answer.acceleration, answer.steering, answer.intent, plan)
    if isinstance(answer, protocol.TrajectoryMessage):
        return Trajectory(answer.times.array(), answer.poses.array(), answer.intent)
    if isinstance(answer, protocol.InvalidMessage):
        raise PlannerOutputError(answer.reason[:500])
    raise ProtocolError(f"{type(answer).__name__} is no answer to an observation")


def _number(value: object) -> float:
    # Text and complex numbers have no __float__.
    if not hasattr(type(value), "__float__"):
        raise PlannerOutputError(f"holds {type(value).__name__}, expected a number")
    return float(value)  # type: ignore[arg-type]


def _floats(name: str, value: Any, width: int) -> protocol.Floats:
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiu":
        raise PlannerOutputError(f"{name} is {type(value).__name__}, expected a NumPy array of numbers")
    good = value.ndim == 1 if width == 1 else value.ndim == 2 and value.shape[1] == width
    if not good or len(value) > MAX_TRAJECTORY_POSES:
        raise PlannerOutputError(f"{name} has shape {value.shape}, expected at most {MAX_TRAJECTORY_POSES} rows")
    single = value.dtype == np.float32
    return protocol.Floats(
        "<f4" if single else "<f8", value.shape, np.asarray(value, "<f4" if single else "<f8").tobytes()
    )


def _intent(edges: object) -> tuple[str, ...]:
    if not isinstance(edges, tuple) or not all(isinstance(edge, str) for edge in edges):
        raise PlannerOutputError("intent is no tuple of edge ids")
    return tuple(map(str.__str__, edges))
