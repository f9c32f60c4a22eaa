"""What driving shows of a pair of halves. Source: docs/spec/contrast.md, "Certificate of a pair". Units: m, s, m/s."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import zip_longest

import numpy as np

from tsbench.episode.outcome import EpisodeFacts
from tsbench.planners.base import Control, Observation, Planner, PlannerContext, Privilege, Trajectory
from tsbench.sim.scene import Scene
from tsbench.sim.world import WorldSnapshot

_STOP = Control(-3.0, 0.0)
# Positions and speeds of SUMO's own arithmetic, in m and m/s.
_SAME = 1e-6


class Recorder:
    """A planner, what it was told and first shown, and all its answers of its last episode."""

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self.context: PlannerContext | None = None
        self.first: Observation | None = None
        self.answers: list[Control | Trajectory] = []

    def reset(self, context: PlannerContext) -> None:
        """Begin anew."""
        self.context, self.first, self.answers = context, None, []
        self._planner.reset(context)

    def act(self, observation: Observation) -> Control | Trajectory:
        """The planner's answer."""
        if self.first is None:
            self.first = observation
        self.answers.append(self._planner.act(observation))
        return self.answers[-1]


class Replay:
    """Recorded answers, whatever is seen; behind the last one it stops."""

    def __init__(self, answers: Sequence[Control | Trajectory]) -> None:
        self._answers = answers

    def reset(self, context: PlannerContext) -> None:
        """Nothing to forget."""

    def act(self, observation: Observation) -> Control | Trajectory:
        """The answer of this tick."""
        return self._answers[observation.step] if observation.step < len(self._answers) else _STOP


class Prejudiced:
    """An expert that obeys another scene's plate, whatever stands here: as who always obeys what it once learned."""

    def __init__(self, expert: Planner, plate: Privilege) -> None:
        self._expert, self._plate = expert, plate

    def reset(self, context: PlannerContext) -> None:
        """Begin anew, told the other plate."""
        self._expert.reset(replace(context, privilege=self._plate))

    def act(self, observation: Observation) -> Control | Trajectory:
        """The expert's answer."""
        return self._expert.act(observation)


def seen_without_plates(o: Observation) -> tuple[object, ...]:
    """All that a first observation shows of ego, way, others, obstacles and posts, but for what hangs on these."""
    a = o.actors
    others = (a.pose, a.speed, a.lane, a.lane_s, a.length, a.width, a.kind)
    posts = sorted((s.x, s.y, s.heading) for s in o.signs)
    way = (o.route.path.edges, o.route.s, o.route.d, o.route.remaining)
    return (o.ego, way, o.history.tobytes(), *(array.tobytes() for array in others), posts, o.obstacles)


def first_difference(a: EpisodeFacts, b: EpisodeFacts) -> WorldSnapshot | None:
    """The tick of `a` at which others first do something else than in `b`, None where they never do.

    Of two episodes with the same commands, as long as both last.
    """
    for one, other in zip_longest(a.snapshots, b.snapshots):
        if one is None or other is None:
            return None
        if len(one.actors) != len(other.actors) or not (
            np.allclose(one.actors.pose, other.actors.pose, rtol=0.0, atol=_SAME)
            and np.allclose(one.actors.speed, other.actors.speed, rtol=0.0, atol=_SAME)
        ):
            return one
    return None


def line_point(scene: Scene) -> tuple[float, float]:
    """Where the ego would have to stop, in the network's frame: before those who come, or at the plate."""
    agents = scene.convoy or scene.walkers
    if agents is not None:
        line = scene.network.lane(agents.line_lane).line
        return line.point_at(line.length)
    post = scene.target_sign
    return scene.network.edge_lanes(post.edge)[max(post.lane, 0)].line.point_at(post.position_m)


def braking_before(line: tuple[float, float], tick: WorldSnapshot) -> float | None:
    """Deceleration with which the ego stops at a line that is ahead of it, None where it is past it; m/s2."""
    x, y = tick.ego.front
    ahead = (line[0] - x) * math.cos(tick.ego.heading) + (line[1] - y) * math.sin(tick.ego.heading)
    return None if ahead <= 0.0 else tick.ego.speed**2 / (2.0 * ahead)
