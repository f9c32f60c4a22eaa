"""What passes at every tick has the bytes that the general form of the protocol gives, and is read as by it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import tsbench
from tsbench.planners.base import Observation, SignView
from tsbench.run.isolation.commands import command_message, read_command
from tsbench.run.isolation.episode_messages import _read_signs, _signs_message
from tsbench.run.isolation.protocol import HEAD, MessageKind, ProtocolError, pack, unpack
from tsbench.run.isolation.ticks import read_tick, tick_message
from tsbench.sim.navigation import RouteView
from tsbench.sim.world import Agents, EgoState


def observation(n: int, m: int) -> Observation:
    path: Any = None
    real, whole, small = np.arange(n) + 0.5, np.arange(n, dtype=np.int32), np.arange(n, dtype=np.int8)
    agents = Agents(whole, np.arange(3.0 * n).reshape(n, 3), real, real, real, small, -whole, small % 3, ())
    signs = tuple(SignView("2.4", None, 0.0, 0.0, 0.0, "e", 0, 1.0, 10.0 + k) for k in range(m))
    ego = EgoState(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8, 9.0, 10.0, True)
    return Observation(
        7, 0.7, ego, np.arange(12.0).reshape(3, 4), RouteView(path, 1.5, -0.5, np.inf), agents, signs, ()
    )


def test_plates_arrive_as_they_were_told() -> None:
    front = SignView("2.1", None, 1.0, 2.0, 0.5, "e", -1, 3.0, 10.0, "diamond", (-1.5, np.pi))
    limit = SignView("3.24", 40.0, 1.0, 2.0, 0.5, "e", 1, 3.0, 20.0, "circle")
    signs = (front, limit, limit.from_behind(), front.from_behind(), front.masked())
    told = [
        (s.code, s.edge, s.outline, s.lane, s.main_road, s.value, s.x, s.y, s.heading, s.position_m)
        for s in signs
    ]
    read = _read_signs(_signs_message(told)[HEAD.size :])
    assert repr(tuple(make(s.distance) for make, s in zip(read, signs, strict=True))) == repr(signs)


@pytest.mark.parametrize(("n", "m"), [(0, 0), (1, 0), (3, 1), (4, 2), (17, 5)])
def test_an_observation_has_the_bytes_of_the_general_form(n: int, m: int) -> None:
    o = observation(n, m)
    e, a = o.ego, o.actors
    numbers = (
        o.step, o.time, e.x, e.y, e.heading, e.speed, e.acceleration, e.steering, e.yaw_rate, e.s, e.d,
        o.route.s, o.route.d, o.route.remaining,
    )  # fmt: skip
    away = tuple(sign.distance for sign in o.signs)
    message = tick_message(o)
    assert message == pack(
        MessageKind.OBSERVATION,
        numbers,
        (e.lane, e.on_road),
        o.history,
        a.pose,
        a.speed,
        a.lane,
        a.indicator,
        away,
    )
    body = message[HEAD.size :]
    tick, general = read_tick(body), unpack(MessageKind.OBSERVATION, body)
    assert tick.numbers == numbers
    assert (tick.lane, tick.on_road, tick.distances) == (8, True, list(away))
    arrays = (tick.history, tick.poses, tick.speeds, tick.lanes, tick.indicators)
    for array, same, was in zip(
        arrays, general[2:7], (o.history, a.pose, a.speed, a.lane, a.indicator), strict=True
    ):
        assert array.dtype == was.dtype
        assert np.array_equal(array, was)
        assert np.array_equal(array.ravel(), same)
        assert array.flags.aligned
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


def test_an_observation_cut_short_is_none() -> None:
    body = tick_message(observation(3, 2))[HEAD.size :]
    for wrong in (body[:-1], body[:40], b"", body + bytes(16), b"\xff" * len(body)):
        with pytest.raises(ProtocolError):
            read_tick(wrong)


@pytest.mark.parametrize("intent", [(), ("a",), ("-12#3", "straße", "x" * 16)])
def test_a_control_has_the_bytes_of_the_general_form(intent: tuple[str, ...]) -> None:
    control = tsbench.Control(1.0, -0.25, intent)
    message = command_message(control)
    assert message == pack(MessageKind.CONTROL, (1.0, -0.25), "\n".join(intent), (False,), ())
    assert read_command(MessageKind.CONTROL, message[HEAD.size :]) == control
    planned = replace(control, plan=np.arange(6.0).reshape(3, 2))
    read: Any = read_command(MessageKind.CONTROL, command_message(planned)[HEAD.size :])
    assert read == control
    assert np.array_equal(read.plan, planned.plan)


def test_text_that_is_none_is_no_control() -> None:
    body = bytearray(command_message(tsbench.Control(1.0, 0.5, ("edge",)))[HEAD.size :])
    body[32] = 0xFF
    with pytest.raises(ProtocolError):
        read_command(MessageKind.CONTROL, bytes(body))
