"""Experts (`-e`): any base planner, constrained near the target sign by what its rule says.

An expert reads the target rule exactly (`PlannerContext.privilege`) and of the rest of the world what every
planner sees: never the future, never the convoy's release plan. The base planner is given the guard's route
for its own, and its command is capped by what the guard leaves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from tsbench.errors import InputError
from tsbench.planners.ahead import HALF_LENGTH_M
from tsbench.planners.base import Control, Observation, Planner, PlannerContext, Privilege, Trajectory
from tsbench.planners.guards.base import Guard, slow_to
from tsbench.planners.guards.closed_road import ClosedRoadGuard
from tsbench.planners.guards.courtesy import Courtesy
from tsbench.planners.guards.crosswalk import CrosswalkGuard
from tsbench.planners.guards.detour import DetourGuard
from tsbench.planners.guards.give_way import GiveWayGuard
from tsbench.planners.guards.manoeuvre import ManoeuvreGuard
from tsbench.planners.guards.no_entry import NoEntryGuard
from tsbench.planners.guards.reserved_lane import ReservedLaneGuard
from tsbench.planners.guards.roundabout import RoundaboutGuard
from tsbench.planners.guards.speed import MinSpeedGuard, SpeedGuard
from tsbench.planners.guards.stop import StopGuard
from tsbench.planners.idm import Idm
from tsbench.planners.lane_change import LaneChanges
from tsbench.planners.steering import follow
from tsbench.planners.styles import IdmS1, IdmS2, IdmS3, IdmS4
from tsbench.signs.rule_kinds import for_every_kind
from tsbench.sim.ego import Motion, track
from tsbench.sim.world import EgoState

GUARDS: Mapping[str, Callable[[PlannerContext, Privilege], Guard]] = for_every_kind(
    "expert's constraint",
    {
        "give_way": GiveWayGuard,
        "stop": StopGuard,
        "roundabout": RoundaboutGuard,
        "crosswalk": CrosswalkGuard,
        "speed": SpeedGuard,
        "min_speed": MinSpeedGuard,
        "detour": DetourGuard,
        "closed_road": ClosedRoadGuard,
        "manoeuvre": ManoeuvreGuard,
        "one_way_exit": ManoeuvreGuard,
        "no_entry": NoEntryGuard,
        "reserved_lane": ReservedLaneGuard,
    },
)

_BRAKE_MPS2 = 2.0


class Expert:
    """One wrapper for every base planner."""

    privileged = True
    sign_access = True

    def __init__(self, base: Planner) -> None:
        self._base = base
        self._guard: Guard
        self._lanes: LaneChanges
        self._courtesy: Courtesy

    def reset(self, context: PlannerContext) -> None:
        """Start an episode; the base planner is not told what the expert may know."""
        privilege = context.privilege
        if privilege is None:
            raise InputError(
                "an expert needs PlannerContext.privilege: run it as a planner with privileged = True"
            )
        self._guard = GUARDS[privilege.rule.name](context, privilege)
        self._lanes = LaneChanges(context)
        # A guard that looks after a junction itself says from which approach, and where right of way is not enough.
        self._courtesy = Courtesy(context, but=self._guard.approach, wary=self._guard.wary)
        self._base.reset(replace(context, privilege=None))

    def act(self, observation: Observation) -> Control:
        """The base planner's command on the guard's route, within what the guard leaves."""
        o, guard = observation, self._guard
        route = guard.guide(o)
        led = route is not o.route
        seen = o
        if led:
            seen = Observation(o.step, o.time, o.ego, o.history, route, o.actors, o.signs, o.obstacles)
        acceleration, steering = _control(self._base.act(seen), o.ego)
        least, most = guard.bounds(o, route)
        most = min(most, self._courtesy.bounds(o, route)[1])
        if led and not getattr(self._base, "follows_route", False):
            # A base that has learned its own way would leave the guard's: here the way is the rule.
            way, stop = self._lanes.guide(o, route)
            steering = follow(way, o.ego)
            most = min(most, slow_to(o.ego.speed, 0.0, stop - way.s - HALF_LENGTH_M, _BRAKE_MPS2))
        return Control(min(max(acceleration, least), most), steering, route.path.edges if led else ())


def _control(command: Control | Trajectory, ego: EgoState) -> tuple[float, float]:
    """Acceleration and steering of a command; trajectories by the harness's own tracker."""
    if isinstance(command, Control):
        return command.acceleration, command.steering
    motion = Motion(ego.x, ego.y, ego.heading, ego.speed, ego.acceleration, ego.steering, ego.yaw_rate)
    return track(
        motion, np.asarray(command.times, dtype=np.float64), np.asarray(command.poses, dtype=np.float64)
    )


class IdmExpert(Expert):
    """`idm-e`."""

    def __init__(self) -> None:
        super().__init__(Idm())


class IdmS1Expert(Expert):
    """`idm-s1-e`."""

    def __init__(self) -> None:
        super().__init__(IdmS1())


class IdmS2Expert(Expert):
    """`idm-s2-e`."""

    def __init__(self) -> None:
        super().__init__(IdmS2())


class IdmS3Expert(Expert):
    """`idm-s3-e`."""

    def __init__(self) -> None:
        super().__init__(IdmS3())


class IdmS4Expert(Expert):
    """`idm-s4-e`."""

    def __init__(self) -> None:
        super().__init__(IdmS4())
