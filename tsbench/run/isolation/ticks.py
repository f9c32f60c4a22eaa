"""What passes at every tick, OBSERVATION and CONTROL: as `pack` and `unpack` have it, in a third of the time."""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

import numpy as np

from tsbench.planners.base import Observation
from tsbench.run.isolation.protocol import ALIGNED, HEAD, MessageKind, ProtocolError

_NUMBERS, _LANE = 14, 2
# Counts, numbers and the ego's lane, each filled up.
_FIRST = struct.Struct(f"<8I{_NUMBERS}d{_LANE}i8x")
_F8, _I4, _I1 = np.dtype("<f8"), np.dtype("<i4"), np.dtype("i1")
_ZEROS = tuple(bytes(-size % ALIGNED) for size in range(ALIGNED))
# Of CONTROL, up to its intent; behind that are 16 bytes more where there is no plan.
_CONTROL = struct.Struct("<4I2d")
_NO_PLAN = bytes(ALIGNED)


class Tick(NamedTuple):
    """The fields of OBSERVATION as they are used; arrays are read-only views of the message."""

    numbers: tuple[float, ...]
    lane: int
    on_road: bool
    history: Any
    poses: Any
    speeds: Any
    lanes: Any
    indicators: Any
    distances: list[float]


def tick_message(o: Observation) -> bytes:
    a, ego, route, signs = o.actors, o.ego, o.route, o.signs
    history = np.asarray(o.history, _F8).tobytes()
    n, m = len(a.ids), len(signs)
    parts = [
        history,
        _filled(np.asarray(a.pose, _F8).tobytes()), _filled(np.asarray(a.speed, _F8).tobytes()),
        _filled(np.asarray(a.lane, _I4).tobytes()), _filled(np.asarray(a.indicator, _I1).tobytes()),
        _filled(struct.pack(f"<{m}d", *[sign.distance for sign in signs])),
    ]  # fmt: skip
    first = _FIRST.pack(
        _NUMBERS, _LANE, len(history) // 8, 3 * n, n, n, n, m,
        o.step, o.time, ego.x, ego.y, ego.heading, ego.speed, ego.acceleration, ego.steering, ego.yaw_rate,
        ego.s, ego.d, route.s, route.d, route.remaining, ego.lane, ego.on_road,
    )  # fmt: skip
    head = HEAD.pack(len(first) + sum(map(len, parts)), MessageKind.OBSERVATION)
    return b"".join((head, first, *parts))


def read_tick(body: bytes) -> Tick:
    """Raises ProtocolError."""
    try:
        numbers, two, h, three_n, n, n_lanes, n_indicators, m, *values = _FIRST.unpack_from(body)
        at = _FIRST.size
        history = np.frombuffer(body, _F8, h, at).reshape(-1, 4)
        at += 8 * h
        poses = np.frombuffer(body, _F8, three_n, at).reshape(-1, 3)
        at += _room(8 * three_n)
        speeds = np.frombuffer(body, _F8, n, at)
        at += _room(8 * n)
        lanes = np.frombuffer(body, _I4, n_lanes, at)
        at += _room(4 * n_lanes)
        indicators = np.frombuffer(body, _I1, n_indicators, at)
        at += _room(n_indicators)
        distances = np.frombuffer(body, _F8, m, at).tolist()
        at += _room(8 * m)
    except (struct.error, ValueError) as problem:
        raise ProtocolError(f"OBSERVATION: {problem}") from None
    if numbers != _NUMBERS or two != _LANE or at != len(body):
        raise ProtocolError(f"OBSERVATION: {len(body)} bytes, its counts say otherwise")
    *told, lane, on_road = values
    return Tick(tuple(told), lane, on_road == 1, history, poses, speeds, lanes, indicators, distances)


def plain_control_message(acceleration: float, steering: float, intent: str) -> bytes:
    """CONTROL without a plan."""
    text = intent.encode()
    more = _filled(text) + _NO_PLAN
    head = HEAD.pack(_CONTROL.size + len(more), MessageKind.CONTROL)
    return head + _CONTROL.pack(2, len(text), 1, 0, acceleration, steering) + more


def read_plain_control(body: bytes) -> tuple[float, float, str] | None:
    """Its two numbers and its intent; None for any other CONTROL, and for what is none."""
    if len(body) < _CONTROL.size:
        return None
    two, size, one, points, acceleration, steering = _CONTROL.unpack_from(body)
    begin, end = _CONTROL.size, _CONTROL.size + size
    if (two, one, points) != (2, 1, 0) or body[begin + _room(size) :] != _NO_PLAN:
        return None
    try:
        return acceleration, steering, body[begin:end].decode()
    except UnicodeDecodeError:
        return None


def _filled(data: bytes) -> bytes:
    return data + _ZEROS[len(data) % ALIGNED]


def _room(size: int) -> int:
    return size + -size % ALIGNED
