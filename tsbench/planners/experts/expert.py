"""Experts (`-e`): any base planner, constrained near the target signs by what their rules say.

An expert reads the targets' rules exactly (`PlannerContext.privilege`), SUMO's network with its priorities, and who the
others are and where they go (`Observation.truth`): never the convoy's release plan. The base planner is given the rule
constraints' route for its own, and its command is capped by what they leave.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from tsbench.core.errors import InputError, import_all
from tsbench.planners.base import Control, Planner, PlannerContext, Privilege, Trajectory
from tsbench.planners.experts.rules.constraint import RuleConstraint, slow_to
from tsbench.planners.experts.rules.gap_acceptance import RightOfWay
from tsbench.planners.geometry import HALF_LENGTH_M
from tsbench.planners.lane_change import LaneChanges, follow
from tsbench.planners.observation import Observation
from tsbench.signs.annotations import SignInstance
from tsbench.signs.rule_kinds import RULE_KINDS, load_rule_classes
from tsbench.sim.ego import Motion, track
from tsbench.sim.world import EgoState

_HALF_WIDTH_M = 1.0
_CLEARANCE_M = 0.3
_WINDOW_M = 60.0


class ObstacleFilter:
    """A base planner without the obstacles beside its route, and without those that it has begun to pass.

    Learned planners stop before an obstacle on the lane, as their teachers did, and know no route that leads around it;
    an expert that leads them past such an obstacle would wait for ever.
    """

    def __init__(self, base: Planner) -> None:
        self._base = base

    def reset(self, context: PlannerContext) -> None:
        self._base.reset(context)

    def act(self, observation: Observation) -> Control | Trajectory:
        o = observation
        if not o.obstacles:
            return self._base.act(o)
        line, s = o.route.path.line, o.route.s
        kept = []
        for thing in o.obstacles:
            at, aside = line.project(thing.x, thing.y, s - _WINDOW_M, s + _WINDOW_M)
            turned = thing.heading - line.heading_at(at)
            c, n = abs(math.cos(turned)), abs(math.sin(turned))
            wide = 0.5 * (c * thing.width + n * thing.length)
            if at > s - HALF_LENGTH_M and abs(aside) - wide < _HALF_WIDTH_M + _CLEARANCE_M:
                kept.append(thing)
        return self._base.act(replace(o, obstacles=tuple(kept)))


# By kind of rule: the constraint in the file of its name.
CONSTRAINTS: Mapping[str, Callable[[PlannerContext, Privilege, SignInstance], RuleConstraint]] = load_rule_classes(
    import_all("tsbench.planners.experts.rules"), RuleConstraint, "_constraint"
)

_BRAKE_MPS2 = 2.0


class Expert:
    """One wrapper for every base planner: `NAME-e` is `Expert(NAME)`.

    A base with `follows_route = True` steers along whatever route it is shown and minds what stands on it. Any other is
    steered by the expert where that leads, and not shown what stands beside the way.
    """

    privileged = True
    sign_access = True

    def __init__(self, base: Planner) -> None:
        self._follows = bool(getattr(base, "follows_route", False))
        self._base = base if self._follows else ObstacleFilter(base)
        self._constraints: tuple[RuleConstraint, ...] = ()
        self._lanes: LaneChanges
        self._right_of_way: RightOfWay

    def reset(self, context: PlannerContext) -> None:
        """Start an episode; the base planner is not told what the expert may know."""
        privilege = context.privilege
        if privilege is None:
            raise InputError("an expert needs PlannerContext.privilege: run it as a planner with privileged = True")
        kinds = ((privilege.rule(sign).name, sign) for sign in privilege.signs)
        self._constraints = tuple(
            CONSTRAINTS[kind](context, privilege, sign) for kind, sign in kinds if RULE_KINDS[kind].binds(sign.params)
        )
        self._lanes = LaneChanges(context)
        # A constraint that minds a junction itself says from which approach, and where right of way is not enough.
        self._right_of_way = RightOfWay(
            privilege,
            but=frozenset(one.approach for one in self._constraints),
            alert_edges=frozenset(edge for one in self._constraints for edge in one.alert_edges),
        )
        self._base.reset(replace(context, privilege=None))

    def act(self, observation: Observation) -> Control:
        """The base planner's command on the constraints' route, within what they leave."""
        o = observation
        route = o.route
        # Each goes by the route of those before it.
        for one in self._constraints:
            route = one.route(o if route is o.route else replace(o, route=route))
        led = route is not o.route
        # The base planner sees what it would see alone.
        seen = Observation(o.step, o.time, o.ego, o.history, route, o.actors, o.signs, o.obstacles)
        acceleration, steering = _control(self._base.act(seen), o.ego)
        bounds = [one.acceleration_bounds(o, route) for one in self._constraints]
        least = max((low for low, _ in bounds), default=-math.inf)
        most = min([self._right_of_way.acceleration_bounds(o, route)[1], *(high for _, high in bounds)])
        if led and not self._follows:
            # A base that has learned its own way would leave the constraint's: here the way is the rule.
            way, stop = self._lanes.route(o, route)
            steering = follow(way, o.ego)
            most = min(most, slow_to(o.ego.speed, 0.0, stop - way.s - HALF_LENGTH_M, _BRAKE_MPS2))
        return Control(min(max(acceleration, least), most), steering, route.path.edges if led else ())


def _control(command: Control | Trajectory, ego: EgoState) -> tuple[float, float]:
    """Acceleration and steering of a command; trajectories by the harness's own tracker."""
    if isinstance(command, Control):
        return command.acceleration, command.steering
    motion = Motion(ego.x, ego.y, ego.heading, ego.speed, ego.acceleration, ego.steering, ego.yaw_rate)
    return track(motion, np.asarray(command.times, dtype=np.float64), np.asarray(command.poses, dtype=np.float64))
