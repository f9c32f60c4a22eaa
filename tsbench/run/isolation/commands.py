"""Commands as messages, both ways."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tsbench.core.errors import PlannerOutputError, cause_of
from tsbench.planners.base import Control, Trajectory
from tsbench.run.isolation.maps import fixed
from tsbench.run.isolation.protocol import MessageKind, ProtocolError, lines, pack, unpack
from tsbench.run.isolation.ticks import plain_control_message, read_plain_control
from tsbench.sim.ego import MAX_TRAJECTORY_POSES

Output = Control | Trajectory


def command_message(output: object) -> bytes:
    """What a planner returned, or that it is no command."""
    try:
        if isinstance(output, Control):
            # A number of the planner's own making may raise what it likes.
            numbers = (_number(output.acceleration), _number(output.steering))
            plan = output.plan
            intent = _intent(output.intent)
            if plan is None:
                return plain_control_message(*numbers, intent)
            return pack(MessageKind.CONTROL, numbers, intent, (True,), _array("Control.plan", plan, 2))
        if isinstance(output, Trajectory):
            times, poses = output.times, output.poses
            if isinstance(times, np.ndarray) and isinstance(poses, np.ndarray) and len(times) != len(poses):
                raise PlannerOutputError(f"times and poses have shapes {times.shape} and {poses.shape}")
            single = [getattr(part, "dtype", None) == np.float32 for part in (times, poses)]
            return pack(
                MessageKind.TRAJECTORY, single, _array("Trajectory.times", times, 1),
                _array("Trajectory.poses", poses, 3), _intent(output.intent),
            )  # fmt: skip
    except KeyboardInterrupt:
        raise
    except BaseException as problem:
        return pack(
            MessageKind.INVALID, f"{type(output).__name__} cannot be read ({cause_of(problem)})"[:500]
        )
    return pack(
        MessageKind.INVALID, f"act returned {type(output).__name__}, expected Control or Trajectory"[:500]
    )


def read_command(kind: MessageKind, body: bytes) -> Output:
    """The command of a message. Raises PlannerOutputError or ProtocolError."""
    if kind is MessageKind.CONTROL:
        plain = read_plain_control(body)
        if plain is not None:
            acceleration, steering, edges = plain
            return Control(acceleration, steering, _edges(edges))
        numbers, intent, has_plan, plan = unpack(kind, body)
        if len(numbers) != 2 or len(has_plan) != 1 or len(plan) % 2:
            raise ProtocolError("CONTROL: not two numbers and a plan of pairs")
        points = fixed(plan.reshape(-1, 2)) if has_plan[0] else None
        return Control(float(numbers[0]), float(numbers[1]), _edges(intent), points)
    if kind is MessageKind.TRAJECTORY:
        single, times, poses, intent = unpack(kind, body)
        if len(single) != 2 or len(poses) != 3 * len(times):
            raise ProtocolError("TRAJECTORY: not three numbers for each time")
        dtypes = [np.float32 if one else np.float64 for one in single]
        return Trajectory(times.astype(dtypes[0]), poses.reshape(-1, 3).astype(dtypes[1]), _edges(intent))
    if kind is MessageKind.INVALID:
        raise PlannerOutputError(unpack(kind, body)[0][:500])
    raise ProtocolError(f"{kind.name} is no answer to an observation")


def _number(value: object) -> float:
    # Text and complex numbers have no __float__.
    if not hasattr(type(value), "__float__"):
        raise PlannerOutputError(f"holds {type(value).__name__}, expected a number")
    return float(value)  # type: ignore[arg-type]


def _array(name: str, value: Any, width: int) -> Any:
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiu":
        raise PlannerOutputError(f"{name} is {type(value).__name__}, expected a NumPy array of numbers")
    good = value.ndim == 1 if width == 1 else value.ndim == 2 and value.shape[1] == width
    if not good or len(value) > MAX_TRAJECTORY_POSES:
        raise PlannerOutputError(
            f"{name} has shape {value.shape}, expected at most {MAX_TRAJECTORY_POSES} rows"
        )
    return value


def _intent(edges: Sequence[str]) -> str:
    if not isinstance(edges, tuple) or any(not isinstance(edge, str) or "\n" in edge for edge in edges):
        raise PlannerOutputError("intent is no tuple of edge ids")
    return lines(edges)


def _edges(text: str) -> tuple[str, ...]:
    return tuple(text.split("\n")) if text else ()
