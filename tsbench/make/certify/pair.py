"""What driving shows of a pair of halves. Source: docs/contrast.md, "Certificate of a pair". Units: m, s, m/s."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from lxml import etree

from tsbench.episode.blind_view import blind_bytes
from tsbench.planners.base import Control, Observation, Planner, PlannerContext, Privilege, Trajectory
from tsbench.signs.contrast import CONTRAST
from tsbench.sim.junction_traffic import exchangeable
from tsbench.sim.scene import Scene, SceneFile
from tsbench.sim.scene_file import read_additional
from tsbench.sim.world import WorldSnapshot

_STOP = Control(-3.0, 0.0)
# Positions and speeds of SUMO's own arithmetic, in m and m/s.
_SAME = 1e-6
# Points of a scene's file for the ego's judge and driver alone: plates, what is needless, the asked way.
_OF_THE_EGO = ("sign", CONTRAST, "start")


class Recorder:
    """A planner, and of its last episode what it was told, its answers, and the digest of what it was first shown.

    view: SHA-256 (hex) of that with plates masked; "" of an expert, who is shown more, and where nothing was shown.
    """

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self.context: PlannerContext | None = None
        self.view = ""
        self.answers: list[Control | Trajectory] = []

    def reset(self, context: PlannerContext) -> None:
        """Begin anew."""
        self.context, self.view, self.answers = context, "", []
        self._planner.reset(context)

    def act(self, observation: Observation) -> Control | Trajectory:
        """The planner's answer."""
        if not self.answers and self.context is not None and self.context.privilege is None:
            self.view = hashlib.sha256(blind_bytes(self.context, observation)).hexdigest()
        self.answers.append(self._planner.act(observation))
        return self.answers[-1]


class AnswerReplay:
    """Recorded answers, whatever is seen; behind the last one it stops."""

    def __init__(self, answers: Sequence[Control | Trajectory]) -> None:
        self._answers = answers

    def reset(self, context: PlannerContext) -> None:
        """Nothing to forget."""

    def act(self, observation: Observation) -> Control | Trajectory:
        """The answer of this tick."""
        return self._answers[observation.step] if observation.step < len(self._answers) else _STOP


class Prejudiced:
    """An expert that obeys the plate of the other half, whatever stands here: as who always drives by one habit."""

    def __init__(self, expert: Planner, other: Privilege) -> None:
        self._expert, self._other = expert, other

    def reset(self, context: PlannerContext) -> None:
        """Begin anew, on this half's network but told the other one's plate."""
        assert context.privilege is not None
        told = replace(context.privilege, sign=self._other.sign)
        self._expert.reset(replace(context, privilege=told))

    def act(self, observation: Observation) -> Control | Trajectory:
        """The expert's answer."""
        return self._expert.act(observation)


def alike_to_others(a: Scene, b: Scene) -> bool:
    """Do two scenes tell SUMO and those who release others the same?

    They differ then in plates alone, which others do not read: under the same commands of an ego they all do the same.
    """
    return (
        a.net.content == b.net.content
        and exchangeable(a) == exchangeable(b)
        and _for_others(a.additional) == _for_others(b.additional)
    )


def _for_others(file: SceneFile) -> list[bytes]:
    root = read_additional(file.path, file.content)
    return [etree.tostring(one) for one in root if one.get("type") not in _OF_THE_EGO]


def others_differ(one: WorldSnapshot, other: WorldSnapshot) -> bool:
    """Do others do something else at one of two ticks than at the other?"""
    return len(one.actors) != len(other.actors) or not (
        np.allclose(one.actors.pose, other.actors.pose, rtol=0.0, atol=_SAME)
        and np.allclose(one.actors.speed, other.actors.speed, rtol=0.0, atol=_SAME)
    )


def line_point(scene: Scene) -> tuple[float, float]:
    """Where the ego would have to stop, in the network's frame: before oncoming road users, or at the plate."""
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
