"""What drives show of a scene and of a pair of halves, and the drivers that are tried on them.

Recorded, replayed and prejudiced drives: docs/contrast.md, "Certificate of a pair". Watchers read no plate and wait for
others to tell: docs/contrast.md, "Reaction must not be enough". Whatever they do, others must do the same in both
halves until the ego waits at its line, or cannot stop any more before it meets them. Units: m, s, m/s, m/s2, rad.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from lxml import etree

from tsbench.core.seeds import rng_of
from tsbench.episode.outcome import EpisodeFacts
from tsbench.episode.traffic_view import blind_bytes
from tsbench.geometry.footprint import boxes_overlap
from tsbench.geometry.polyline import Array
from tsbench.planners.base import Control, Planner, PlannerContext, Privilege, Trajectory
from tsbench.planners.idm import Idm, IdmParameters
from tsbench.planners.lane_change import AHEAD_S, LEAST_AHEAD_M
from tsbench.planners.observation import Observation
from tsbench.signs.contrast import CONTRAST
from tsbench.sim.convoy import Approach, ConvoyRelease, Showing
from tsbench.sim.ego import pursue
from tsbench.sim.junction_traffic import exchangeable
from tsbench.sim.scene import Scene, SceneFile
from tsbench.sim.scene_file import read_additional
from tsbench.sim.world import DT_S, EGO_LENGTH_M, Actors, Agents, EgoState, WorldSnapshot

_STOP = Control(-3.0, 0.0)
# Positions and speeds of SUMO's own arithmetic, in m and m/s.
_SAME = 1e-6
# Points of a scene's file for the ego's judge and driver alone: plates, what is needless, the asked way.
_OF_THE_EGO = ("sign", CONTRAST, "start")
EVERY_TICKS = 5
# Cars that pass close in a narrow bend brush each other in SUMO by centimetres; this much is a collision.
DEEP_M = 0.5
THIN_M = 0.05
_CRAWL_MPS = 1.5
_BRAKE_MPS2, _HARD_MPS2 = 2.5, 6.0
_STANDS_MPS = 0.05
_NEAR_M = 1.0
# Those who leave their lane look so much farther ahead than others: it is left over some metres.
_SWING_M = 4.0
_BESIDE_M = 48.0
_OTHER_LANE_M, _VERGE_M = 3.0, 2.2
# How many of them a certificate tries on a pair.
_TRIED = 2


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
    """An expert that obeys the plates of the other half, whatever stands here: as who always drives by one habit."""

    def __init__(self, expert: Planner, other: Privilege) -> None:
        self._expert, self._other = expert, other

    def reset(self, context: PlannerContext) -> None:
        """Begin anew, on this half's network but told the other one's plates."""
        assert context.privilege is not None
        told = replace(context.privilege, signs=self._other.signs)
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
        _same(one.actors.pose, other.actors.pose) and _same(one.actors.speed, other.actors.speed)
    )


def _same(a: Array, b: Array) -> bool:
    # Nearly always equal, which is known several times sooner.
    return np.array_equal(a, b) or np.allclose(a, b, rtol=0.0, atol=_SAME)


def line_point(scene: Scene) -> tuple[float, float]:
    """Where the ego would have to stop, in the network's frame: before oncoming road users, or at the plate."""
    agents = scene.convoy or scene.walkers
    if agents is not None:
        line = scene.network.lane(agents.line_lane).line
        return line.point_at(line.length)
    post = scene.target_signs[0]
    return scene.network.edge_lanes(post.edge)[max(post.lane, 0)].line.point_at(post.position_m)


def braking_before(line: tuple[float, float], tick: WorldSnapshot) -> float | None:
    """Deceleration with which the ego stops at a line that is ahead of it, None where it is past it; m/s2."""
    x, y = tick.ego.front
    ahead = (line[0] - x) * math.cos(tick.ego.heading) + (line[1] - y) * math.sin(tick.ego.heading)
    return None if ahead <= 0.0 else tick.ego.speed**2 / (2.0 * ahead)


def road_users(facts: EpisodeFacts) -> int:
    """How many other road users came within sight of the ego."""
    return len(facts.snapshots[-1].actors.table.ids)


def overlapping_pairs(facts: EpisodeFacts) -> int:
    """Pairs of other road users whose bodies overlap by more than half a metre at some tick (every half second)."""
    found: set[tuple[int, int]] = set()
    for snapshot in facts.snapshots[::EVERY_TICKS]:
        found.update(_overlaps(snapshot.actors))
    return len(found)


def _overlaps(actors: Actors) -> list[tuple[int, int]]:
    pose, length, width = actors.pose, actors.length, actors.width
    if len(pose) < 2:
        return []
    dx = pose[:, None, 0] - pose[None, :, 0]
    dy = pose[:, None, 1] - pose[None, :, 1]
    reach = 0.5 * np.hypot(length, width)
    near = np.triu(dx * dx + dy * dy < (reach[:, None] + reach[None, :] - DEEP_M) ** 2, 1)
    rows = actors.index
    # Bodies without their outermost quarter of a metre: where these touch, the whole ones overlap deeply.
    cores = [
        (*p, max(float(a) - DEEP_M, THIN_M), max(float(b) - DEEP_M, THIN_M))
        for p, a, b in zip(pose.tolist(), length, width, strict=True)
    ]
    return [
        (int(rows[i]), int(rows[k]))
        for i, k in zip(*np.nonzero(near), strict=True)
        if boxes_overlap(*cores[i], *cores[k])
    ]


def arrival_gap(facts: EpisodeFacts) -> float:
    """Seconds from the ego's arrival at the conflict zone to the lead's, unhindered; NaN without agents.

    The lead's time from its release to the zone is known from when the scene was built. The lead is the first of a
    convoy, or of pedestrians.
    """
    scene = facts.scene
    plan = scene.convoy or scene.walkers
    if plan is None:
        return math.nan
    release = ConvoyRelease(plan, scene.network)
    released = next((s.time for s in facts.snapshots[1:] if release.update(s.ego)), math.nan)
    lane = scene.network.lane(plan.line_lane)
    lanes = frozenset(scene.network.edges[lane.edge].lanes)
    gone: float | None = None
    last = facts.snapshots[0].ego
    for snapshot in facts.snapshots[1:]:
        ego = snapshot.ego
        moved = math.hypot(ego.x - last.x, ego.y - last.y)
        last = ego
        if ego.lane in lanes:
            gone = ego.s + EGO_LENGTH_M / 2 - lane.line.length
        elif gone is not None:
            gone += moved
        if gone is not None and gone >= plan.ego_zone_m:
            return released + plan.lead_time_s - snapshot.time
    return math.nan


@dataclass(frozen=True, slots=True)
class Habit:
    """One way to watch.

    stops: of each stop the place of the front, m before the line, and its time, s. top_speed: at most, m/s. slow: from
    so many metres before the line on, at most so fast, m/s; None: as the road allows. beside: from so many metres
    before the line on, for 48 m, so far to the left, m; None: in its lane.
    """

    name: str
    stops: tuple[tuple[float, float], ...] = ()
    top_speed: float = math.inf
    beside: tuple[float, float] | None = None
    slow: tuple[float, float] | None = None


HABITS = (
    *(Habit(f"stands at {m:.0f} m", ((m, 40.0),)) for m in (45.0, 30.0, 20.0, 13.0, 8.0, 5.5)),
    Habit("crawls", top_speed=_CRAWL_MPS),
    Habit("stops and goes", tuple((m, 3.0) for m in (50.0, 40.0, 30.0, 20.0, 14.0, 10.0, 6.0))),
    *(Habit(f"comes at {v:g} m/s", slow=(18.0, v)) for v in (2.0, 3.0, 4.5)),
    Habit("takes the lane beside", ((20.0, 20.0),), beside=(55.0, _OTHER_LANE_M)),
    Habit("takes the verge", ((20.0, 20.0),), beside=(45.0, -_VERGE_M)),
)


def drawn_habits(pair: str) -> tuple[Habit, ...]:
    """The habits that the certificate of a pair of this name tries."""
    drawn = rng_of("watching", pair).choice(len(HABITS), size=_TRIED, replace=False)
    return tuple(HABITS[k] for k in sorted(drawn.tolist()))


def braking_to_meet(approach: Approach, showing: Showing, ego: EgoState) -> float:
    """Deceleration with which an ego stops before it meets others, while they may not show it anything; m/s2."""
    return ego.speed**2 / (2.0 * (approach.to_line(ego) + showing.zone_m))


class Watcher:
    """A habit at the wheel. approach: tells it where its line is. It brakes for nobody: that would be a reason."""

    privileged = False
    sign_access = False

    def __init__(self, habit: Habit, approach: Approach) -> None:
        self._habit, self._approach = habit, approach
        self._base = Idm(IdmParameters(top_speed=habit.top_speed))
        self._stops: list[list[float]] = []

    def reset(self, context: PlannerContext) -> None:
        """Begin anew."""
        self._base.reset(context)
        self._stops = [list(stop) for stop in self._habit.stops]

    def act(self, observation: Observation) -> Control:
        """The base planner's command, or a harder brake for the next stop."""
        ego = observation.ego
        to_line = self._approach.to_line(ego)
        command = self._base.act(replace(observation, actors=Agents.none()))
        accel, steering = command.acceleration, command.steering
        while self._stops and (self._stops[0][1] <= 0.0 or to_line < self._stops[0][0] - _NEAR_M):
            self._stops.pop(0)
        if self._stops:
            room = to_line - self._stops[0][0]
            if ego.speed <= _STANDS_MPS and room < _NEAR_M:
                self._stops[0][1] -= DT_S
                accel = min(accel, -ego.speed / DT_S)
            elif ego.speed**2 > 2.0 * _BRAKE_MPS2 * max(room - 0.3, 0.0):
                accel = min(accel, -_BRAKE_MPS2 if room > 0.0 else -_HARD_MPS2)
        slow, beside = self._habit.slow, self._habit.beside
        if slow is not None and to_line < slow[0]:
            accel = min(accel, max((slow[1] - ego.speed) / 0.5, -_BRAKE_MPS2))
        if beside is not None and beside[0] - _BESIDE_M < to_line < beside[0]:
            route = observation.route
            ahead = route.s + max(LEAST_AHEAD_M + _SWING_M, AHEAD_S * ego.speed)
            steering = pursue(ego.x, ego.y, ego.heading, *route.path.line.point_at(ahead, beside[1]))
        return Control(accel, steering)
