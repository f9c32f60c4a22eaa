"""How an episode ends. Source: docs/metrics.md, "How an episode ends".

Whose fault a contact is: nuPlan's "no ego at-fault collisions", brought down to what footprints say.

The ego is at fault where it moved and struck with its front or a side that it swung in; it is not where it
stood, or where the other came from behind. Units: m, rad, m/s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from enum import IntEnum, StrEnum
from typing import Any

from tsbench.core.benchmark import ARRIVAL_M
from tsbench.episode.perception import SignDetection
from tsbench.geometry.elementary import wrap
from tsbench.geometry.footprint import boxes_overlap
from tsbench.geometry.polyline import Array
from tsbench.planners.base import Plan
from tsbench.rules.monitor import Monitor, Verdicts, Violation
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.navigation import RouteView
from tsbench.sim.scene import Obstacle, Scene
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M, ActorKind, Actors, EgoState, WorldSnapshot, ego_box

_EGO_RADIUS_M = math.hypot(EGO_LENGTH_M, EGO_WIDTH_M) / 2


STOPPED_MPS = 0.05
_SAME_WAY_RAD = math.radians(60.0)
_SAMPLES = 9


def touched_actor(ego: EgoState, actors: Actors) -> int:
    """Position in `actors` of the first one whose footprint overlaps the ego's, or -1."""
    ex, ey = ego.x, ego.y
    # Half the longest body plus a metre and a half is beyond any corner of a road vehicle.
    reach = actors.table.longest * 0.5 + 1.5 + _EGO_RADIUS_M
    for k, box in enumerate(actors.boxes):
        dx, dy = box[0] - ex, box[1] - ey
        if dx * dx + dy * dy < reach * reach and boxes_overlap(*ego_box(ego), *box):
            return k
    return -1


def touched_obstacle(ego: EgoState, obstacles: tuple[Obstacle, ...]) -> Obstacle | None:
    """The first obstacle that the ego's footprint overlaps."""
    for o in obstacles:
        if boxes_overlap(*ego_box(ego), o.x, o.y, o.heading, o.length, o.width):
            return o
    return None


class Outcome(StrEnum):
    """Exactly one per episode; the last four are errors."""

    ARRIVED = "arrived"
    COLLISION = "collision"
    OFF_ROAD = "off_road"
    TIMEOUT = "timeout"
    PLANNER_ERROR = "planner_error"
    PLANNER_TIMEOUT = "planner_timeout"
    INVALID_OUTPUT = "invalid_output"
    SIM_ERROR = "sim_error"

    @property
    def is_error(self) -> bool:
        """Did the episode break off without a result?"""
        return self in _ERRORS


_ERRORS = (Outcome.PLANNER_ERROR, Outcome.PLANNER_TIMEOUT, Outcome.INVALID_OUTPUT, Outcome.SIM_ERROR)


@dataclass(frozen=True, slots=True)
class Contact:
    """The contact that ended an episode. partner_kind: vehicle | pedestrian | obstacle; partner: SUMO id."""

    step: int
    partner_kind: str
    partner: str
    at_fault: bool


class TerminationCheck:
    """Says of each tick whether the episode ends there, and how; the same during a run and from its trace.

    targets: the monitors of the scenario's own signs, which have taken in the tick before. contact: the one that ended
    the episode, None where none did.
    """

    def __init__(self, scene: Scene, targets: tuple[Monitor, ...]) -> None:
        self.contact: Contact | None = None
        self._scene, self._targets = scene, targets
        self._dest_lanes = frozenset(scene.network.edges[scene.destination.edge].lanes)

    def at(self, snapshot: WorldSnapshot) -> Outcome | None:
        """The outcome if this tick is the last. Contact wins over arrival, arrival over the horizon."""
        ego = snapshot.ego
        self.contact = self._touched(snapshot)
        if self.contact is not None:
            return Outcome.COLLISION
        if not ego.on_road:
            return Outcome.OFF_ROAD
        if ego.lane in self._dest_lanes and abs(ego.s - self._scene.destination.s) <= ARRIVAL_M:
            return Outcome.ARRIVED
        if any(monitor.completed for monitor in self._targets):
            return Outcome.ARRIVED
        if snapshot.step >= self._scene.horizon:
            return Outcome.TIMEOUT
        return None

    def _touched(self, snapshot: WorldSnapshot) -> Contact | None:
        ego, actors = snapshot.ego, snapshot.actors
        hit = touched_actor(ego, actors)
        if hit >= 0:
            row = int(actors.index[hit])
            kind = "pedestrian" if actors.table.kind[row] == ActorKind.PEDESTRIAN else "vehicle"
            size = float(actors.length[hit]), float(actors.width[hit])
            fault = contact_at_fault(ego, actors.pose[hit], float(actors.speed[hit]), *size)
            return Contact(snapshot.step, kind, actors.table.ids[row], fault)
        obstacle = touched_obstacle(ego, self._scene.obstacles)
        return None if obstacle is None else Contact(snapshot.step, "obstacle", obstacle.id, True)


@dataclass(frozen=True, kw_only=True)
class Course:
    """What happened in an episode, and the verdicts on it.

    snapshots: one per tick, step 0 first. start_remaining_m: way to go at step 0.
    """

    snapshots: list[WorldSnapshot]
    start_remaining_m: float
    outcome: Outcome
    contact: Contact | None
    verdicts: Verdicts

    @property
    def against(self) -> tuple[Violation, ...]:
        """What counts against SCD, in order of time."""
        return self.verdicts.against

    def course(self) -> dict[str, Any]:
        """Its fields, for another class with them."""
        return {field.name: getattr(self, field.name) for field in fields(Course)}


@dataclass(frozen=True, kw_only=True)
class EpisodeFacts(Course):
    """The input of every per-episode metric. route: the navigation view at the last tick."""

    scene: Scene
    route: RouteView


@dataclass(frozen=True)
class EpisodeResult:
    """One episode. `facts` is None if it ended before the first tick (a scene that does not load).

    error: one line, or ""; detail: traceback and SUMO's last words for `errors/`.
    planner_s: (n,) seconds that the planner took at each tick; sim_s, start_s, total_s: wall-clock seconds.
    commands: (n, 2) acceleration and steering as asked by the planner (or its trajectory's tracker).
    plans: where the planner meant to drive, with each command that told it.
    told: what it was told of plates, where its eyes were not exact.
    """

    spec: ScenarioSpec
    planner: str
    outcome: Outcome
    error: str
    detail: str
    facts: EpisodeFacts | None
    commands: Array
    planner_s: Array
    start_s: float
    sim_s: float
    total_s: float
    plans: tuple[Plan | None, ...] = field(default=(), kw_only=True)
    told: tuple[SignDetection, ...] = field(default=(), kw_only=True)


class Phase(IntEnum):
    """Told at each change; PLANNING is the planner's own time, making it and `reset` included."""

    IDLE = 0
    LOADING = 1
    SIMULATING = 2
    PLANNING = 3
    SCORING = 4

    @property
    def words(self) -> str:
        return _WORDS[self]


_WORDS = ("between episodes", "loading the scene", "in the simulation", "in the planner", "in the monitors")


def contact_at_fault(ego: EgoState, pose: Array, speed: float, length: float, width: float) -> bool:
    """Is the ego at fault for touching this road user? Both as of the tick of the contact.

    pose: (3,) x, y, heading of the other's centre. Like nuPlan's: a stopped ego is never at fault, a stopped
    other was hit by the ego, and what touches the ego's rear ran into it, unless the ego goes the same way
    faster.
    """
    if ego.speed <= STOPPED_MPS:
        return False
    if speed <= STOPPED_MPS:
        return True
    along = _contact_along(ego, pose, length, width)
    if along > 0.0:
        return True
    same_way = abs(wrap(float(pose[2]) - ego.heading)) <= _SAME_WAY_RAD
    # Behind its middle the ego is struck, unless it swerves or rolls into one that it overtakes.
    struck_from_behind = along <= -EGO_LENGTH_M / 4
    return not (struck_from_behind and (not same_way or speed >= ego.speed))


def _contact_along(ego: EgoState, pose: Array, length: float, width: float) -> float:
    """Where the footprints meet, m ahead (+) of the ego's centre: mean of outline points in the other."""
    c, s = math.cos(ego.heading), math.sin(ego.heading)
    dx, dy = float(pose[0]) - ego.x, float(pose[1]) - ego.y
    ox, oy = dx * c + dy * s, -dx * s + dy * c
    turn = float(pose[2]) - ego.heading
    tc, ts = math.cos(turn), math.sin(turn)
    half_l, half_w = EGO_LENGTH_M / 2, EGO_WIDTH_M / 2
    found = []
    for u, v in _outline(length / 2, width / 2):
        x, y = ox + u * tc - v * ts, oy + u * ts + v * tc
        if abs(x) <= half_l and abs(y) <= half_w:
            found.append(x)
    for u, v in _outline(half_l, half_w):
        x, y = (u - ox) * tc + (v - oy) * ts, -(u - ox) * ts + (v - oy) * tc
        if abs(x) <= length / 2 and abs(y) <= width / 2:
            found.append(u)
    return sum(found) / len(found) if found else ox


def _outline(half_l: float, half_w: float) -> list[tuple[float, float]]:
    """Points along the outline of a rectangle around the origin."""
    steps = [2.0 * k / (_SAMPLES - 1) - 1.0 for k in range(_SAMPLES)]
    ends = [(sign * half_l, t * half_w) for sign in (1.0, -1.0) for t in steps]
    sides = [(t * half_l, sign * half_w) for sign in (1.0, -1.0) for t in steps]
    return ends + sides
