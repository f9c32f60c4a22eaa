"""Planners of few words for tests of the loop: `scripted:Follow` and so on."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from tsbench import Control, Observation, PlannerContext, Trajectory, pursue_route


class Scripted:
    """Keeps what it was shown last, for tests that look at it."""

    contexts: ClassVar[list[PlannerContext]] = []
    seen: ClassVar[list[Observation]] = []
    made: ClassVar[int] = 0

    def __init__(self) -> None:
        Scripted.made += 1

    def reset(self, context: PlannerContext) -> None:
        Scripted.contexts.append(context)
        Scripted.seen.clear()

    def act(self, o: Observation) -> Control | Trajectory:
        Scripted.seen.append(o)
        return self.command(o)

    def command(self, o: Observation) -> Control | Trajectory:
        raise NotImplementedError


class Follow(Scripted):
    """8 m/s along the route, whatever is in the way."""

    def command(self, o: Observation) -> Control:
        return Control(8.0 - o.ego.speed, pursue_route(o))


class FollowPoses(Scripted):
    """The same as a trajectory."""

    def command(self, o: Observation) -> Trajectory:
        times = 0.1 * np.arange(1, 21)
        points = [o.route.path.line.point_at(o.route.s + 8.0 * t) for t in times]
        headings = [o.route.path.line.heading_at(o.route.s + 8.0 * t) for t in times]
        return Trajectory(times, np.column_stack((np.array(points), headings)))


class Privileged(Follow):
    """Asks for the rule."""

    privileged = True


class Straight(Scripted):
    """Full throttle straight on."""

    def command(self, o: Observation) -> Control:
        return Control(3.0, 0.0)


class Stand(Scripted):
    """Does not move."""

    def command(self, o: Observation) -> Control:
        return Control(-6.0, 0.0)


class Swerve(Scripted):
    """To the right, off the road."""

    def command(self, o: Observation) -> Control:
        return Control(0.0, -0.3)


class RaisesReset(Follow):
    def reset(self, context: PlannerContext) -> None:
        raise RuntimeError("reset: no\nmap")


class RaisesAct(Follow):
    def command(self, o: Observation) -> Control:
        if o.step == 5:
            raise KeyError("at step five")
        return super().command(o)


class NotFinite(Follow):
    def command(self, o: Observation) -> Control:
        return Control(math.nan if o.step == 3 else 0.0, 0.0)


class Nothing(Follow):
    def command(self, o: Observation):  # type: ignore[no-untyped-def]
        return None


class WrongShape(Follow):
    def command(self, o: Observation) -> Trajectory:
        return Trajectory(np.array([0.5]), np.zeros((1, 2)))


class Indicates(Follow):
    """Shows that it means to go where no connection leads, in the middle of its way."""

    def command(self, o: Observation) -> Control:
        plain = super().command(o)
        return Control(plain.acceleration, plain.steering, ("w_in", "e_in") if o.step > 3 else ())


class IndicatesRight(Follow):
    """Shows that it means to turn right at the crossroads, and does not."""

    def command(self, o: Observation) -> Control:
        plain = super().command(o)
        return Control(plain.acceleration, plain.steering, ("w_in", "s_out"))
