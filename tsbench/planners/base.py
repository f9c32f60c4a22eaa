"""The planner contract: what a planner is, is told and gives back, and how that is read. Units: m, s, m/s, rad.

What it sees: `tsbench.planners.observation`.

A planner is a class with `reset(context)` and `act(observation) -> Control | Trajectory`, or a function
`observation -> Control`. The runner times it; nothing in here is written to by a planner.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from tsbench.core.errors import InputError, PlannerOutputError, cause_of
from tsbench.geometry.polyline import Array
from tsbench.planners.observation import Observation
from tsbench.roads.lane_graph import Destination, MapGraph
from tsbench.roads.network import RoadNetwork
from tsbench.roads.planner_map import PlannerMap
from tsbench.roads.road_map import RoadMap
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import Catalog, RuleSpec
from tsbench.sim.ego import MAX_TRAJECTORY_POSES, Motion, check_trajectory, track

Command = tuple[float, float]
Plan = npt.NDArray[np.float32]
_FARTHEST_M = 1e6


@dataclass(frozen=True, slots=True)
class Control:
    """Acceleration (m/s2) and steering angle (rad, left positive); clipped to the vehicle's limits.

    intent: edges that the ego means to drive from where it is, as a driver's indicators tell others; () = the
    navigation's way. Other traffic goes by it when it gives way. plan: (k, 2) where the ego means to drive, in the
    world frame; it is kept in the trace and drawn in pictures, and nothing else comes of it.
    """

    acceleration: float
    steering: float
    intent: tuple[str, ...] = ()
    plan: Array | None = field(default=None, compare=False)


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Future poses that the harness's own tracker follows.

    times: (k,) s from now, increasing, first > 0: the present pose is no part of it. poses: (k, 3) x, y, heading of the
    ego's centre in the world frame; they are its plan. At most 1,000. intent: as in `Control`.
    """

    times: Array
    poses: Array
    intent: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Privilege:
    """What experts may read beyond what all planners see: the target signs' rules, exactly; never the future.

    signs: the targets, on the edges of `network`, which is SUMO's with its priorities. catalog: signs as they bind
    here. view: from the network to the map. `Observation.truth` goes with it.
    """

    signs: tuple[SignInstance, ...]
    catalog: Catalog
    network: RoadNetwork
    view: PlannerMap

    def rule(self, sign: SignInstance) -> RuleSpec:
        """What a target asks."""
        return self.catalog.sign(sign.code).rule


@dataclass(frozen=True, slots=True)
class PlannerContext:
    """Given once per episode; frozen and read-only throughout.

    seed: the same in both halves of a pair. network: the map, without what plates decide. privilege: None but for
    experts.
    """

    seed: int
    network: RoadMap
    graph: MapGraph
    destination: Destination
    dt: float
    privilege: Privilege | None = None


@runtime_checkable
class Planner(Protocol):
    """What the runner calls.

    A planner with `privileged = True` is given `PlannerContext.privilege` and `Observation.truth`, and flagged in
    results.
    """

    def reset(self, context: PlannerContext) -> None:
        """Start an episode: drop all state of the one before."""

    def act(self, observation: Observation) -> Control | Trajectory:
        """One command for the next 0.1 s."""


def to_command(output: object, motion: Motion, network: RoadMap) -> tuple[Command, tuple[str, ...]]:
    """((acceleration, steering), intent) of a planner's output. Raises PlannerOutputError with what is wrong."""
    try:
        if isinstance(output, Control):
            return _numbers(output), _intent(output.intent, network)
        if isinstance(output, Trajectory):
            return _tracked(output, motion), _intent(output.intent, network)
    except (PlannerOutputError, KeyboardInterrupt):
        raise
    except BaseException as error:
        # A number of the planner's own making may raise what it likes.
        raise PlannerOutputError(f"{type(output).__name__} cannot be read ({cause_of(error)})") from error
    raise PlannerOutputError(f"act returned {type(output).__name__}, expected Control or Trajectory")


def to_plan(output: Any) -> Plan | None:
    """Where the ego means to drive, (k, 2), by a Control or Trajectory; None where it tells nothing.

    A plain array of our own: what the planner does with its own later changes nothing. Raises PlannerOutputError.
    """
    name = "Trajectory.poses" if isinstance(output, Trajectory) else "Control.plan"
    try:
        points = output.poses[:, :2] if isinstance(output, Trajectory) else output.plan
        if points is None:
            return None
        _check_array(name, points)
        if points.ndim != 2 or points.shape[1] != 2 or len(points) > MAX_TRAJECTORY_POSES:
            raise PlannerOutputError(f"{name} has shape {points.shape}, expected (k, 2)")
        if np.isnan(points).any():
            raise PlannerOutputError(f"{name} holds NaN")
        return np.array(np.clip(points, -_FARTHEST_M, _FARTHEST_M), dtype=np.float32, subok=False)
    except (PlannerOutputError, KeyboardInterrupt):
        raise
    except BaseException as error:
        raise PlannerOutputError(f"{name} cannot be read ({cause_of(error)})") from error


def _numbers(control: Control) -> Command:
    acceleration, steering = control.acceleration, control.steering
    # Text and complex numbers have no __float__.
    if not all(hasattr(type(value), "__float__") for value in (acceleration, steering)):
        raise PlannerOutputError(
            f"Control holds {type(acceleration).__name__} and {type(steering).__name__}, expected two numbers"
        )
    try:
        acceleration, steering = float(acceleration), float(steering)
    except (TypeError, ValueError, OverflowError) as error:
        raise PlannerOutputError(f"Control holds what is no number of a vehicle ({error})") from None
    if not (math.isfinite(acceleration) and math.isfinite(steering)):
        raise PlannerOutputError(f"Control is not finite: acceleration {acceleration}, steering {steering}")
    return acceleration, steering


def _tracked(trajectory: Trajectory, motion: Motion) -> Command:
    times, poses = trajectory.times, trajectory.poses
    for name, array in (("times", times), ("poses", poses)):
        _check_array(f"Trajectory.{name}", array)
    check_trajectory(times, poses)
    command = track(motion, times, poses)
    if not all(map(math.isfinite, command)):
        raise PlannerOutputError("trajectory leads beyond what numbers can hold")
    return command


def _check_array(name: str, array: object) -> None:
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu":
        kind = f"an array of {array.dtype}" if isinstance(array, np.ndarray) else type(array).__name__
        raise PlannerOutputError(f"{name} is {kind}, expected a NumPy array of numbers")


def _intent(edges: object, network: RoadMap) -> tuple[str, ...]:
    if not isinstance(edges, tuple):
        raise PlannerOutputError(f"intent is {type(edges).__name__}, expected a tuple of edge ids")
    for edge in edges:
        if not isinstance(edge, str) or edge not in network.edges:
            raise PlannerOutputError(f"intent names edge {edge!r:.80}, which is not in the network")
    # Plain ones of the network's own: what is kept runs no code of the planner.
    return tuple(network.edges[edge].id for edge in edges)


DEVICES = ("cpu", "cuda")

Records = npt.NDArray[np.void]
# (b,) records in, (b,) records out; a row's answer does not depend on the other rows, to the bit.
Infer = Callable[[Records], Records]


@runtime_checkable
class Batched(Protocol):
    """What the class of such a planner has besides `reset` and `act`. Its constructor takes `infer`: Infer | None, the
    network that answers its records; None = its network on the CPU.

    inputs: dtype of the records. served_on: devices that its network runs on besides the CPU.
    """

    inputs: ClassVar[np.dtype[Any]]
    served_on: ClassVar[tuple[str, ...]]

    @staticmethod
    def network(device: str) -> Infer:
        """Load the network on `cpu` or a device of `served_on`."""


def check_device(device: str) -> None:
    """Raises InputError where torch does not see the device."""
    import torch

    if device == "cuda" and not torch.cuda.is_available():
        raise InputError("--device cuda: torch sees no CUDA device here")
