"""What driving shows of a pair of halves. Source: docs/spec/contrast.md, "Certificate of a pair". Units: m, s, m/s."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from itertools import zip_longest

import numpy as np

from tsbench.episode.blind_view import blind_bytes
from tsbench.episode.outcome import EpisodeFacts
from tsbench.planners.base import Control, Observation, Planner, PlannerContext, Trajectory
from tsbench.signs.annotations import SignInstance
from tsbench.sim.world import WorldSnapshot

_STOP = Control(-3.0, 0.0)
# Positions and speeds of SUMO's own arithmetic, in m and m/s.
_SAME = 1e-6


class Recorder:
    """A planner, and of its last episode its answers and the digest of its first view with plates masked, "" if none.

    blind: is the planner shown no more than others are? An expert's view has no such digest.
    """

    def __init__(self, planner: Planner, blind: bool) -> None:
        self._planner, self._blind = planner, blind
        self._context: PlannerContext | None = None
        self.view = ""
        self.answers: list[Control | Trajectory] = []

    def reset(self, context: PlannerContext) -> None:
        """Begin anew."""
        self._context, self.view, self.answers = context, "", []
        self._planner.reset(context)

    def act(self, observation: Observation) -> Control | Trajectory:
        """The planner's answer."""
        if self._blind and not self.answers and self._context is not None:
            self.view = hashlib.sha256(blind_bytes(self._context, observation)).hexdigest()
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


def first_difference(a: EpisodeFacts, b: EpisodeFacts) -> WorldSnapshot | None:
    """The tick at which others first do something else, None where they never do while both egos are alike.

    Of two episodes of one driver; where the egos part first, what follows is their own doing.
    """
    for one, other in zip_longest(a.snapshots, b.snapshots):
        if one is None or other is None:
            return None
        if len(one.actors) != len(other.actors) or not (
            np.allclose(one.actors.pose, other.actors.pose, rtol=0.0, atol=_SAME)
            and np.allclose(one.actors.speed, other.actors.speed, rtol=0.0, atol=_SAME)
        ):
            return one
        if math.hypot(one.ego.x - other.ego.x, one.ego.y - other.ego.y) > _SAME:
            return None
    return None


def braking_before(post: SignInstance, tick: WorldSnapshot) -> float | None:
    """Deceleration with which the ego stops at a post that is ahead of it, None where it is past it; m/s2."""
    x, y = tick.ego.front
    ahead = (post.x - x) * math.cos(tick.ego.heading) + (post.y - y) * math.sin(tick.ego.heading)
    return None if ahead <= 0.0 else tick.ego.speed**2 / (2.0 * ahead)
