"""PDM-like: the best of fifteen proposals by the PDM score, and a full stop where even that soon collides."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsbench.bridges.nuplan.states import StateSE2, TimePoint
from tsbench.bridges.pdm.centerline import Centerline, Route
from tsbench.bridges.pdm.proposals import STEP_S, STEPS, Others, Proposals, roll_out, stop
from tsbench.bridges.pdm.scoring import score

_SIGHT_M = 60.0
_EMERGENCY_S = 2.0
_LONGER = 4


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
