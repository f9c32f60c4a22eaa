"""Drives a planner that speaks nuPlan's `AbstractPlanner` protocol: initialize, compute_planner_trajectory.

The protocol goes by names alone (duck typing): nuplan-devkit is not needed, and a planner that uses it runs, too. Its
trajectory is followed by the tracker that follows every `Trajectory`. Units: m, s, rad.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any, ClassVar, Protocol

import numpy as np

from tsbench.adapters.nuplan.nuplan_map import NuPlanMap
from tsbench.adapters.nuplan.states import (
    HALF_BASE_M,
    DetectionsTracks,
    EgoState,
    StateSE2,
    TimePoint,
    TrackedObjects,
    TrackedObjectType,
)
from tsbench.core.errors import InputError
from tsbench.geometry.polyline import Array
from tsbench.planners.base import Observation, PlannerContext, SignView, Trajectory
from tsbench.roads.lane_graph import RoutePath

_KEPT = 21
_SOON_S = 1e-3


@dataclass(frozen=True, slots=True)
class PlannerInitialization:
    """route_roadblock_ids: the navigation's way, roadblocks and connectors in order. mission_goal: its end."""

    route_roadblock_ids: list[str]
    mission_goal: StateSE2
    map_api: NuPlanMap


@dataclass(frozen=True, slots=True)
class SimulationIteration:
    time_point: TimePoint
    index: int

    @property
    def time_us(self) -> int:
        return self.time_point.time_us

    @property
    def time_s(self) -> float:
        return self.time_point.time_s


@dataclass(frozen=True, slots=True)
class SimulationHistoryBuffer:
    """The last 2 s, oldest first, the present last. sample_interval: s."""

    ego_states: list[EgoState]
    observations: list[DetectionsTracks]
    sample_interval: float

    @property
    def current_state(self) -> tuple[EgoState, DetectionsTracks]:
        return self.ego_states[-1], self.observations[-1]

    @property
    def ego_state_buffer(self) -> list[EgoState]:
        return self.ego_states

    @property
    def observation_buffer(self) -> list[DetectionsTracks]:
        return self.observations

    @property
    def size(self) -> int:
        return len(self.ego_states)


@dataclass(frozen=True, slots=True)
class PlannerInput:
    """traffic_signs is tsbench's own: nuPlan has no signs. Plates as any planner here sees them."""

    iteration: SimulationIteration
    history: SimulationHistoryBuffer
    traffic_light_data: list[Any]
    traffic_signs: tuple[SignView, ...]


class AbstractPlanner(Protocol):
    """What is asked of the planner. Its trajectory has `get_sampled_trajectory()`: states of rear_axle, time_point."""

    def initialize(self, initialization: Any) -> None: ...

    def compute_planner_trajectory(self, current_input: Any) -> Any: ...


class NuPlanPlanner:
    """Base of an adapter: name the planner in a class of your own and give that to `--planner` (docs/adapters.md).

    make: returns the planner. every: ticks from one question to the next; between, its last trajectory is followed.
    object_types: the enum that kinds of objects are told in, by name; nuPlan's own where the planner compares with it.
    """

    make: ClassVar[Callable[[], AbstractPlanner]]
    every: ClassVar[int] = 1
    object_types: ClassVar[type[Enum]] = TrackedObjectType

    def __init__(self) -> None:
        if not hasattr(type(self), "make"):
            raise InputError(f"{type(self).__name__}: say which planner: make = staticmethod(MyPlanner)")
        self._planner = type(self).make()
        self._map: NuPlanMap
        self._context: PlannerContext
        self._path: RoutePath | None = None
        self._route: list[str] = []
        self._asked = 0
        self._states: deque[tuple[EgoState, DetectionsTracks]] = deque(maxlen=_KEPT)
        self._times: Array
        self._poses: Array

    def reset(self, context: PlannerContext) -> None:
        self._context, self._map = context, NuPlanMap(context.network)
        self._path, self._route = None, []
        self._states.clear()

    def act(self, observation: Observation) -> Trajectory:
        """Ask, where it is time, and follow the answer."""
        o = observation
        now = TimePoint(round(o.time * 1e6))
        found = DetectionsTracks(TrackedObjects(o, now, self.object_types))
        self._states.append((EgoState.of(o.ego, now), found))
        fresh = self._tell_route(o)
        if fresh or o.step - self._asked >= self.every:
            self._asked = o.step
            self._times, self._poses = self._ask(o, now)
        left = self._times - o.time
        ahead = left > _SOON_S
        if not ahead.any():
            raise InputError(f"{self._name()}: its trajectory ends before it is asked again")
        return Trajectory(left[ahead], self._poses[ahead])

    def _tell_route(self, o: Observation) -> bool:
        """Initialise the planner where the navigation leads another way than it was told."""
        if o.route.path is self._path:
            return False
        self._path = path = o.route.path
        told = self._map.route_ids(path.edges)
        if told == self._route[-len(told) :]:
            return False
        self._route = told
        x, y = path.line.point_at(path.destination_s)
        goal = StateSE2(x, y, path.line.heading_at(path.destination_s))
        self._planner.initialize(PlannerInitialization(list(told), goal, self._map))
        return True

    def _ask(self, o: Observation, now: TimePoint) -> tuple[Array, Array]:
        """(times of the episode (k,), poses of the centre (k, 3)) of the planner's trajectory."""
        states, tracks = (list(part) for part in zip(*self._states, strict=True))
        history = SimulationHistoryBuffer(states, tracks, self._context.dt)
        asked = PlannerInput(SimulationIteration(now, o.step), history, [], o.signs)
        answer = self._planner.compute_planner_trajectory(asked)
        rows = [_row(state) for state in answer.get_sampled_trajectory()]
        kept = np.array([row for row in rows if row[0] > o.time + _SOON_S])
        if not len(kept):
            raise InputError(f"{self._name()}: no state of its trajectory is later than now ({o.time:.1f} s)")
        return kept[:, 0], kept[:, 1:]

    def _name(self) -> str:
        return type(self._planner).__name__


def _row(state: Any) -> tuple[float, float, float, float]:
    """Time (s) and pose of the centre. The rear axle counts: a planner may think of a car with other overhangs."""
    pose = state.rear_axle
    c, s = np.cos(pose.heading), np.sin(pose.heading)
    x, y = pose.x + HALF_BASE_M * c, pose.y + HALF_BASE_M * s
    return state.time_point.time_us * 1e-6, float(x), float(y), float(pose.heading)
