"""The ego vehicle: a kinematic bicycle, and the tracker that follows trajectories.

Source: docs/simulation.md, "Time and bodies". The reference point is the footprint's centre; the axles are
half a wheelbase before and behind it. Units: m, s, rad.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tsbench.core.errors import PlannerOutputError
from tsbench.geometry.elementary import wrap
from tsbench.geometry.polyline import Array
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S, WHEELBASE_M

MAX_STEER_RAD = math.radians(40.0)
MAX_STEER_RATE_RAD_S = math.radians(60.0)
MAX_ACCEL_MPS2 = 3.0
MAX_DECEL_MPS2 = 6.0
MAX_SPEED_MPS = 22.2
MAX_TRAJECTORY_POSES = 1000


@dataclass(frozen=True, slots=True)
class Motion:
    """The ego's own motion: centre pose, speed, the acceleration and steering that took effect, yaw rate."""

    x: float
    y: float
    heading: float
    speed: float
    acceleration: float = 0.0
    steering: float = 0.0
    yaw_rate: float = 0.0


def start_motion(scene: Scene) -> Motion:
    """Where the ego of a scene begins: on the middle of its lane, at the scene's speed."""
    line = scene.network.lane(scene.start.lane).line
    x, y = line.point_at(scene.start.s)
    return Motion(x, y, line.heading_at(scene.start.s), scene.start.speed)


def advance(m: Motion, acceleration: float, steering: float) -> Motion:
    """One tick of the bicycle under a command, clipped to the vehicle's limits; the rear axle moves on an arc."""
    a = min(max(acceleration, -MAX_DECEL_MPS2), MAX_ACCEL_MPS2)
    step = MAX_STEER_RATE_RAD_S * DT_S
    wanted = min(max(steering, -MAX_STEER_RAD), MAX_STEER_RAD)
    steer = min(max(wanted, m.steering - step), m.steering + step)
    speed = min(max(m.speed + a * DT_S, 0.0), MAX_SPEED_MPS)
    path = 0.5 * (m.speed + speed) * DT_S
    curvature = math.tan(steer) / WHEELBASE_M
    turn = path * curvature
    half = WHEELBASE_M / 2
    rx, ry = m.x - half * math.cos(m.heading), m.y - half * math.sin(m.heading)
    # Chord of the arc: exact for constant curvature, and well defined for a straight line.
    chord = path * (math.sin(turn / 2) / (turn / 2) if abs(turn) > 1e-9 else 1.0)
    middle, heading = m.heading + turn / 2, wrap(m.heading + turn)
    rx, ry = rx + chord * math.cos(middle), ry + chord * math.sin(middle)
    return Motion(
        x=rx + half * math.cos(heading),
        y=ry + half * math.sin(heading),
        heading=heading,
        speed=speed,
        acceleration=(speed - m.speed) / DT_S,
        steering=steer,
        yaw_rate=turn / DT_S,
    )


def check_trajectory(times: Array, poses: Array) -> None:
    """Raise PlannerOutputError, with the reason, for a trajectory that cannot be followed."""
    if times.shape == (0,):
        raise PlannerOutputError("trajectory is empty: expected at least one pose")
    if times.ndim != 1 or poses.shape != (len(times), 3) or len(times) > MAX_TRAJECTORY_POSES:
        raise PlannerOutputError(
            f"trajectory has shapes {times.shape} and {poses.shape}, expected (k,) and (k, 3) with at "
            f"most {MAX_TRAJECTORY_POSES} poses"
        )
    if not (np.isfinite(times).all() and np.isfinite(poses).all()):
        raise PlannerOutputError("trajectory holds NaN or infinity")
    if times[0] <= 0.0 or np.any(np.diff(times) <= 0.0):
        raise PlannerOutputError("trajectory times must be positive and increasing")


def track(m: Motion, times: Array, poses: Array) -> tuple[float, float]:
    """(acceleration, steering) towards a trajectory: speed from the path length, pure pursuit for steering.

    Looks ahead max(0.5 s, what takes 3 m at the present speed) along the trajectory, at most to its end.
    """
    ahead = min(max(0.5, 3.0 / max(m.speed, 0.1)), float(times[-1]))
    xs = np.concatenate(([m.x], poses[:, 0]))
    ys = np.concatenate(([m.y], poses[:, 1]))
    ts = np.concatenate(([0.0], times))
    arc = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(xs), np.diff(ys)))))
    horizon = min(0.5, float(times[-1]))
    # The mean speed over the horizon is (v + v_end) / 2: solve for the constant acceleration.
    acceleration = 2.0 * (float(np.interp(horizon, ts, arc)) - m.speed * horizon) / horizon**2
    tx, ty = float(np.interp(ahead, ts, xs)), float(np.interp(ahead, ts, ys))
    return acceleration, pursue(m.x, m.y, m.heading, tx, ty)


def pursue(x: float, y: float, heading: float, tx: float, ty: float) -> float:
    """Pure-pursuit steering angle (rad) of a centre pose towards a target point; 0 where it is too near."""
    half = WHEELBASE_M / 2
    dx = tx - (x - half * math.cos(heading))
    dy = ty - (y - half * math.sin(heading))
    dist2 = dx * dx + dy * dy
    if dist2 < 0.25:
        return 0.0
    lateral = -dx * math.sin(heading) + dy * math.cos(heading)
    return math.atan2(2.0 * WHEELBASE_M * lateral, dist2)
