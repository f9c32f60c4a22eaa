"""A proposal planner after PDM-Closed (Dauner et al., CoRL 2023), written against nuPlan's protocol. Sign-blind.

Reimplemented from the paper's description; no line of its code is here. It is told what any nuPlan planner is told and
nothing of tsbench; `Pdm` is the class that `--planner` names. It drives the best of fifteen proposals by the published
PDM score, and makes a full stop where even that soon collides. Units: m, s, rad.

What multiplies: no collision at fault (a fixed thing counts half), on the road. What is weighed: progress 5, time to
collision 5, comfort 2. Source: Dauner et al., "Parting with Misconceptions about Learning-based Vehicle Motion
Planning", CoRL 2023, and nuPlan's closed-loop metrics.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from tsbench.bridges.nuplan import NuPlanPlanner, states
from tsbench.bridges.nuplan.states import StateSE2, TimePoint
from tsbench.bridges.pdm_proposals import STEP_S, STEPS, Centerline, Others, Proposals, Route, roll_out, stop
from tsbench.geometry.polyline import Array

_SIGHT_M = 60.0
_EMERGENCY_S = 2.0
_LONGER = 4
Flags = npt.NDArray[np.bool_]
_PROGRESS, _TTC, _COMFORT = 5.0, 5.0, 2.0
_STANDS_MPS = 0.05
# nuPlan looks 0.9 s on by 0.3; the grid here has 0.2.
_LOOKS = (2, 4)
_LEAST_PROGRESS_M = 0.1
# nuPlan's comfortable accelerations (m/s2), yaw rate (rad/s) and jerk (m/s3).
_BRAKE, _PULL, _ACROSS, _YAW, _JERK = -4.05, 2.40, 4.89, 0.95, 4.13


@dataclass(frozen=True, slots=True)
class TimedPose:
    """A state of the trajectory, as far as a tracker needs it."""

    rear_axle: StateSE2
    time_point: TimePoint


@dataclass(frozen=True, slots=True)
class SampledTrajectory:
    states: list[TimedPose]

    def get_sampled_trajectory(self) -> list[TimedPose]:
        return self.states


class PdmPlanner:
    """Speaks nuPlan's protocol and knows nothing else. Like PDM, it ignores right of way and plates."""

    def name(self) -> str:
        return "pdm"

    def observation_type(self) -> str:
        return "DetectionsTracks"

    def initialize(self, initialization: Any) -> None:
        self._route = Route(initialization)

    def compute_planner_trajectory(self, current_input: Any) -> SampledTrajectory:
        ego, seen = current_input.history.current_state
        pose, box = ego.center, ego.car_footprint.oriented_box
        line = self._route.line(pose.x, pose.y, pose.heading)
        at = line.project(np.array([pose.x]), np.array([pose.y]))
        s0, d0 = float(at[0][0]), float(at[1][0])
        speed = ego.dynamic_car_state.speed
        others = forecast(line, pose, seen.tracked_objects)
        ways = roll_out(line, s0, d0, speed, others, box.length, box.width)
        scores, first = score(line, ways, others, box.length, box.width)
        best = int(np.argmax(scores))
        if first[best] <= _EMERGENCY_S:
            ways, best = stop(line, s0, d0, speed), 0
        base = math.hypot(ego.center.x - ego.rear_axle.x, ego.center.y - ego.rear_axle.y)
        return sampled(ways, best, base, ego.time_point.time_us)


def forecast(line: Centerline, pose: StateSE2, tracked: Any) -> Others:
    """All within 60 m, on at constant velocity."""
    near = [
        one
        for one in tracked.tracked_objects
        if (one.center.x - pose.x) ** 2 + (one.center.y - pose.y) ** 2 < _SIGHT_M**2
    ]
    rows = [
        (one.center.x, one.center.y, one.center.heading, one.velocity.x, one.velocity.y, one.box.length, one.box.width)
        for one in near
    ]
    x, y, heading, vx, vy, length, width = np.array(rows).reshape(-1, 7).T
    still = np.array([one.tracked_object_type.name not in ("VEHICLE", "BICYCLE", "PEDESTRIAN") for one in near], bool)
    t = STEP_S * np.arange(STEPS + 1 + _LONGER)
    xs, ys = x[:, None] + vx[:, None] * t, y[:, None] + vy[:, None] * t
    s, d = (part.reshape(xs.shape) for part in line.project(xs.ravel(), ys.ravel()))
    unit = line.unit[line.segment(s[:, 0])]
    along = np.maximum(unit[:, 0] * vx + unit[:, 1] * vy, 0.0)
    return Others(
        x=xs,
        y=ys,
        s=s,
        d=d,
        along=along,
        cos=np.cos(heading),
        sin=np.sin(heading),
        length=length,
        width=width,
        still=still,
    )


def sampled(ways: Proposals, which: int, base: float, now_us: int) -> SampledTrajectory:
    """One proposal as a trajectory of the rear axle, every 0.2 s. base: from there to the centre, m."""
    states = []
    rows = zip(ways.x[which].tolist(), ways.y[which].tolist(), ways.heading[which].tolist(), strict=True)
    for k, (x, y, heading) in enumerate(rows):
        rear = StateSE2(x - base * math.cos(heading), y - base * math.sin(heading), heading)
        states.append(TimedPose(rear, TimePoint(now_us + k * round(STEP_S * 1e6))))
    return SampledTrajectory(states)


def score(line: Centerline, p: Proposals, o: Others, length: float, width: float) -> tuple[Array, Array]:
    """(scores (m,), when each first is in a collision at fault (m,), s, inf = never)."""
    hits = _overlaps(p, o, 0, length, width)
    now = hits[:, :1].any(axis=0, keepdims=True)
    # A collision is judged where it begins, as forecasts drive on through each other.
    through = np.logical_or.accumulate(hits, axis=1)
    begins = hits & ~now
    begins[:, 1:] &= ~through[:, :-1]
    fault = begins & _before(p, o, length) & (p.speed > _STANDS_MPS)[:, :, None]
    first = np.where(fault.any(axis=(1, 2)), STEP_S * np.argmax(fault.any(axis=2), axis=1), np.inf)
    moving, still = fault[:, :, ~o.still].any(axis=(1, 2)), fault[:, :, o.still].any(axis=(1, 2))
    product = np.where(moving, 0.0, np.where(still, 0.5, 1.0)) * _on_road(line, p, length, width)

    progress = p.s[:, -1] - p.s[:, 0]
    most = float(np.max(progress * (product > 0.0)))
    share = progress / most if most > _LEAST_PROGRESS_M else np.ones(len(progress))
    soon: Flags = np.zeros(len(progress), dtype=np.bool_)
    for look in _LOOKS:
        near = _overlaps(p, o, look, length, width) & _before(p, o, length) & ~through
        soon |= (near & (p.speed > _STANDS_MPS)[:, :, None]).any(axis=(1, 2))
    weighed = _PROGRESS * np.clip(share, 0.0, 1.0) + _TTC * np.where(soon, 0.0, 1.0) + _COMFORT * _comfortable(p)
    return product * weighed / (_PROGRESS + _TTC + _COMFORT), first


def _overlaps(p: Proposals, o: Others, look: int, length: float, width: float) -> Flags:
    """(m, STEPS + 1, n): does the ego, moved on for `look` steps as it goes then, overlap another that is there?"""
    x, y, c, s = _moved(p, look)
    dx = o.x[:, look : look + STEPS + 1].T[None] - x[:, :, None]
    dy = o.y[:, look : look + STEPS + 1].T[None] - y[:, :, None]
    c, s = c[:, :, None], s[:, :, None]
    cosine, sine = np.abs(c * o.cos + s * o.sin), np.abs(c * o.sin - s * o.cos)
    apart = (
        (2.0 * np.abs(dx * c + dy * s) > length + o.length * cosine + o.width * sine)
        | (2.0 * np.abs(dy * c - dx * s) > width + o.length * sine + o.width * cosine)
        | (2.0 * np.abs(dx * o.cos + dy * o.sin) > o.length + length * cosine + width * sine)
        | (2.0 * np.abs(dy * o.cos - dx * o.sin) > o.width + length * sine + width * cosine)
    )
    return np.logical_not(apart)


def _moved(p: Proposals, look: int) -> tuple[Array, Array, Array, Array]:
    c, s = np.cos(p.heading), np.sin(p.heading)
    on = look * STEP_S * p.speed
    return p.x + on * c, p.y + on * s, c, s


def _before(p: Proposals, o: Others, length: float) -> Flags:
    """(m, STEPS + 1, n): is it before the ego's tail axle? A vehicle from behind is at fault itself."""
    x, y, c, s = _moved(p, 0)
    dx = o.x[:, : STEPS + 1].T[None] - x[:, :, None]
    dy = o.y[:, : STEPS + 1].T[None] - y[:, :, None]
    return np.asarray(dx * c[:, :, None] + dy * s[:, :, None] > -0.3 * length)


def _on_road(line: Centerline, p: Proposals, length: float, width: float) -> Array:
    """1.0 where no corner leaves its side of the road by more than 0.2 m and farther than it is out now."""
    k = line.segment(p.s)
    lean = np.abs(np.diff(p.d, axis=1, append=p.d[:, -1:])) / np.maximum(
        np.diff(p.s, axis=1, append=p.s[:, -1:] + 1.0), 1e-3
    )
    half = 0.5 * width + 0.5 * length * np.minimum(lean, 0.3)
    out = np.maximum(np.maximum(p.d + half - line.left[k], half - p.d - line.right[k]), 0.0)
    kept = (out <= np.maximum(out[:, :1], 0.2) + 1e-9).all(axis=1)
    return np.where(kept, 1.0, 0.0)


def _comfortable(p: Proposals) -> Flags:
    along = np.diff(p.speed, axis=1) / STEP_S
    turn = np.abs(np.diff(p.heading, axis=1))
    yaw = np.minimum(turn, 2.0 * np.pi - turn) / STEP_S
    jerk = np.abs(np.diff(along, axis=1)) / STEP_S
    smooth = np.abs(yaw * p.speed[:, 1:])
    return np.asarray(
        (along >= _BRAKE).all(axis=1)
        & (along <= _PULL).all(axis=1)
        & (smooth <= _ACROSS).all(axis=1)
        & (yaw <= _YAW).all(axis=1)
        & (jerk <= _JERK).all(axis=1)
    )


class Pdm(NuPlanPlanner):
    """`tsbench.bridges.pdm:Pdm`: asked every second tick."""

    sign_access = False
    make = staticmethod(PdmPlanner)
    every: ClassVar[int] = 2
    # The same bytes whether or not nuplan-devkit is there.
    kit: ClassVar[Any] = states
