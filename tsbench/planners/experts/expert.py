"""Experts (`-e`): any base planner, constrained near the target sign by what its rule says.

An expert reads the target rule exactly (`PlannerContext.privilege`) and of the rest of the world what every
planner sees: never the future, never the convoy's release plan. The base planner is given the guard's route
for its own, and its command is capped by what the guard leaves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from tsbench.core.errors import InputError
from tsbench.planners.base import Control, Observation, Planner, PlannerContext, Privilege, Trajectory
from tsbench.planners.common.lane_change import LaneChanges
from tsbench.planners.common.pure_pursuit import follow
from tsbench.planners.common.swept_path import HALF_LENGTH_M
from tsbench.planners.experts.rules.closed_road import ClosedRoadConstraint
from tsbench.planners.experts.rules.constraint import RuleConstraint, slow_to
from tsbench.planners.experts.rules.crosswalk import CrosswalkConstraint
from tsbench.planners.experts.rules.detour import DetourConstraint
from tsbench.planners.experts.rules.give_way import GiveWayConstraint
from tsbench.planners.experts.rules.manoeuvre import ManoeuvreConstraint
from tsbench.planners.experts.rules.no_entry import NoEntryConstraint
from tsbench.planners.experts.rules.reserved_lane import ReservedLaneConstraint
from tsbench.planners.experts.rules.right_of_way import RightOfWay
from tsbench.planners.experts.rules.roundabout import RoundaboutConstraint
from tsbench.planners.experts.rules.speed import MinSpeedConstraint, SpeedConstraint
from tsbench.planners.experts.rules.stop import StopConstraint
from tsbench.planners.idm import Idm
from tsbench.planners.styles import IdmS1, IdmS2, IdmS3, IdmS4
from tsbench.signs.rule_kinds import for_every_kind
from tsbench.sim.ego import Motion, track
from tsbench.sim.world import EgoState

CONSTRAINTS: Mapping[str, Callable[[PlannerContext, Privilege], RuleConstraint]] = for_every_kind(
    "expert's constraint",
    {
        "give_way": GiveWayConstraint,
        "stop": StopConstraint,
        "roundabout": RoundaboutConstraint,
        "crosswalk": CrosswalkConstraint,
        "speed": SpeedConstraint,
        "min_speed": MinSpeedConstraint,
        "detour": DetourConstraint,
        "closed_road": ClosedRoadConstraint,
        "manoeuvre": ManoeuvreConstraint,
        "one_way_exit": ManoeuvreConstraint,
        "no_entry": NoEntryConstraint,
        "reserved_lane": ReservedLaneConstraint,
    },
)

_BRAKE_MPS2 = 2.0


class Expert:
    """One wrapper for every base planner."""

    privileged = True
    sign_access = True

    def __init__(self, base: Planner) -> None:
        self._base = base
        self._constraint: RuleConstraint
        self._lanes: LaneChanges
        self._right_of_way: RightOfWay

    def reset(self, context: PlannerContext) -> None:
        """Start an episode; the base planner is not told what the expert may know."""
        privilege = context.privilege
        if privilege is None:
            raise InputError(
                "an expert needs PlannerContext.privilege: run it as a planner with privileged = True"
            )
        self._constraint = CONSTRAINTS[privilege.rule.name](context, privilege)
        self._lanes = LaneChanges(context)
        # A guard that looks after a junction itself says from which approach, and where right of way is not enough.
        self._right_of_way = RightOfWay(
            context, but=self._constraint.approach, alert_edges=self._constraint.alert_edges
        )
        self._base.reset(replace(context, privilege=None))

    def act(self, observation: Observation) -> Control:
        """The base planner's command on the guard's route, within what the guard leaves."""
        o, constraint = observation, self._constraint
        route = constraint.route(o)
        led = route is not o.route
        seen = o
        if led:
            seen = Observation(o.step, o.time, o.ego, o.history, route, o.actors, o.signs, o.obstacles)
        acceleration, steering = _control(self._base.act(seen), o.ego)
        least, most = constraint.acceleration_bounds(o, route)
        most = min(most, self._right_of_way.acceleration_bounds(o, route)[1])
        if led and not getattr(self._base, "follows_route", False):
            # A base that has learned its own way would leave the guard's: here the way is the rule.
            way, stop = self._lanes.route(o, route)
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
