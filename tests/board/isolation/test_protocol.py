"""What a planner is given arrives as it was told, and nothing that it answers is taken for more than it is."""

from __future__ import annotations

import random
import tracemalloc
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

import msgspec
import numpy as np
import pytest

import tsbench
from tsbench.board.isolation.episode_messages import Decoder, Encoder, command_message, read_command
from tsbench.board.isolation.protocol import HEAD, MOST_BYTES, ProtocolError, read_answer
from tsbench.core.errors import PlannerOutputError
from tsbench.core.frozen import Frozen
from tsbench.geometry.polyline import Polyline
from tsbench.planners.base import PlannerContext, Privilege
from tsbench.planners.observation import Observation, SignView
from tsbench.roads.lane_graph import Destination, PathPiece, RoutePath
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.sim.navigation import RouteView
from tsbench.sim.scene import Obstacle
from tsbench.sim.world import ActorKind, Actors, ActorTable, Agents, EgoState, WorldSnapshot

FRONT = SignView("2.1", None, 1.0, 2.0, 0.5, "e", -1, 3.0, 10.0, "diamond", (-1.5, np.pi))
LIMIT = SignView("3.24", 40.0, 1.0, 2.0, 0.5, "e", 1, 3.0, 20.0, "circle")
SIGNS = (FRONT, LIMIT, replace(LIMIT, temporary=True), LIMIT.from_behind(), FRONT.masked())
LINE = Polyline([[0.0, 0.0], [1.0, 0.1], [5.0, 1 / 3]])
PATH = RoutePath(("a", "b"), LINE, (PathPiece(0.0, 4.0, 1),), np.zeros(1), np.array([13.9]), 4.0)


def observation(n: int, table: ActorTable | None = None) -> Observation:
    """With n road users. table: of a true world with as many."""
    real, whole, small = np.arange(n) + 1 / 3, np.arange(n, dtype=np.int32), np.arange(n, dtype=np.int8)
    poses = np.arange(3.0 * n).reshape(n, 3)
    boxes = tuple((*pose, 1 / 3, 2.0) for pose in poses.tolist())
    agents = Agents(whole, poses, real, real, real, small, -whole, small % 3, boxes)
    ego = EgoState(1.0, 2.0, 3.0, -0.0, 5.0, 6.0, 7.0, 8, 9.0, 10.0, True)
    cones = (Obstacle("o", "cones", 1.0, 2.0, 3.0, 4.0, 5.0, "l"),) * (n % 2)
    truth = None if table is None else WorldSnapshot(7, 0.7, ego, Actors(table, whole, poses, real, -whole, real))
    route = RouteView(PATH, 1.5, -0.5, np.inf)
    return Observation(7, 0.7, ego, np.arange(12.0).reshape(3, 4), route, agents, SIGNS, cones, truth)


def heard(decoder: Decoder, message: bytes) -> Any:
    assert HEAD.unpack_from(message) == (len(message) - HEAD.size,)
    return decoder.hear(decoder.read(message[HEAD.size :]))


def check_same(told: Any, was: Any) -> None:
    """The same bits in objects of the same kinds, all the way down."""
    if told is was:
        return
    if isinstance(was, Mapping):
        check_same(tuple(told.items()), tuple(was.items()))
        return
    assert type(told) is type(was)
    if isinstance(was, np.ndarray):
        assert (told.dtype, told.shape, told.tobytes()) == (was.dtype, was.shape, was.tobytes())
        assert told.flags.c_contiguous
        with pytest.raises(ValueError, match="read-only"):
            told[...] = 0
        # As it is freshly allocated: else sums of it might have other bits. One byte alone lies anywhere.
        assert told.nbytes < 2 or told.ctypes.data % 16 == 0
    elif isinstance(was, Frozen):
        for name in type(was).__slots__:
            check_same(getattr(told, name), getattr(was, name))
    elif isinstance(was, frozenset):
        assert told == was
    elif isinstance(was, ActorTable):
        assert (told.ids, told.routes, told.rows) == (was.ids, was.routes, was.rows)
        for name in ("kind", "length", "width", "longest"):
            assert np.array_equal(getattr(told, name), getattr(was, name))
    elif isinstance(was, tuple):
        for one, other in zip(told, was, strict=True):
            check_same(one, other)
    elif is_dataclass(was):
        for field in fields(was):
            check_same(getattr(told, field.name), getattr(was, field.name))
    else:
        assert repr(told) == repr(was)


@pytest.mark.parametrize("n", [0, 1, 3, 17])
def test_an_observation_arrives_as_it_was_told(n: int) -> None:
    encoder, decoder, o = Encoder(), Decoder(), observation(n)
    first = encoder.observation(o)
    told = heard(decoder, first)
    check_same(told, o)
    second = encoder.observation(o)
    assert len(second) < len(first), "a route is told once"
    again = heard(decoder, second)
    check_same(again, o)
    assert again.route.path is told.route.path


def test_the_true_world_arrives_as_it_was_told() -> None:
    encoder, decoder, table = Encoder(), Decoder(), ActorTable()
    for n in (2, 2, 300):
        for k in range(len(table.ids), n):
            table.add(f"v{k}", ActorKind(k % 4), 4 + k / 3, 1.8, ("a", "b")[: k % 3])
        o = observation(n, table)
        check_same(heard(decoder, encoder.observation(o)), o)


def test_contexts_arrive_as_they_were_told() -> None:
    rows = {row.scenario_type: row for row in DataSet().table("dev")}.values()
    assert len(rows) > 10
    encoder, decoder, loader = Encoder(), Decoder(), SceneLoader(DataSet())
    for row in rows:
        scene, roads = loader.load(row)
        view, sign = roads.view, scene.target_signs[0]
        plain = PlannerContext(2**32 - 1, view.map, view.graph, Destination("a", 1 / 3), 0.1)
        left = replace(plain, network=replace(view.map, left_hand=True))
        for given in (plain, replace(plain, privilege=Privilege((sign,), scene.catalog, scene.network, view)), left):
            message = encoder.context(given)
            (size,) = HEAD.unpack_from(message)
            assert heard(decoder, message[: HEAD.size + size]) is None
            told = heard(decoder, message[HEAD.size + size :])
            check_same(told, replace(given, graph=told.graph))
            check_same(told.graph.network, given.network)


@pytest.mark.parametrize("intent", [(), ("a",), ("-12#3", "straße", "x" * 300)])
def test_a_command_arrives_as_it_was_given(intent: tuple[str, ...]) -> None:
    points = np.arange(6.0).reshape(3, 2) / 3
    for given in (
        tsbench.Control(1 / 3, -0.0, intent),
        tsbench.Control(np.inf, np.nan, intent, points),
        tsbench.Control(1.0, 2.0, intent, np.zeros((0, 2))),
        tsbench.Trajectory(np.arange(1.0, 4.0), np.ones((3, 3)), intent),
        tsbench.Trajectory(np.arange(1.0, 4.0, dtype=np.float32), np.ones((3, 3)), intent),
    ):
        check_same(read_command(read_answer(command_message(given)[HEAD.size :])), given)


class Text(str):
    """No plain text."""


@pytest.mark.parametrize(
    ("output", "reason"),
    [
        (tsbench.Control(1.0, 0.0, ("\ud800",)), "Control cannot be read"),
        (tsbench.Control("1", 0.0), "holds str, expected a number"),  # type: ignore[arg-type]
        (tsbench.Control(1.0, 0.0, ["a"]), "intent is no tuple"),  # type: ignore[arg-type]
        (tsbench.Control(1.0, 0.0, plan=np.zeros((1001, 2))), "at most 1000 rows"),
        (tsbench.Control(1.0, 0.0, plan=np.array([["a", "b"]])), "expected a NumPy array of numbers"),
        (tsbench.Trajectory(np.zeros(2), np.zeros((2, 2))), r"Trajectory.poses has shape \(2, 2\)"),
        (None, "act returned NoneType, expected Control or Trajectory"),
    ],
)
def test_what_is_no_command_arrives_with_its_reason(output: object, reason: str) -> None:
    with pytest.raises(PlannerOutputError, match=reason):
        read_command(read_answer(command_message(output)[HEAD.size :]))


def test_an_intent_of_a_kind_of_text_is_text() -> None:
    message = command_message(tsbench.Control(1.0, 0.0, (Text("a"),)))
    check_same(read_command(read_answer(message[HEAD.size :])), tsbench.Control(1.0, 0.0, ("a",)))


def packed(kind: str, **told: Any) -> bytes:
    return msgspec.msgpack.encode({"kind": kind, **told})


CONTROL: dict[str, Any] = {"acceleration": 1.0, "steering": 0.5}
HOSTILE = {
    "nothing": b"",
    "bytes": b"\xff" * 64,
    "cut": packed("control", **CONTROL)[:-1],
    "more": packed("control", **CONTROL) + b"\x00",
    "none": b"\x80",
    "list": msgspec.msgpack.encode(["control", 1.0, 0.5]),
    "unknown": packed("observation"),
    "number": packed("control", acceleration="1", steering=0.5),
    "truth": packed("control", acceleration=True, steering=0.5),
    "missing": packed("control", acceleration=1.0),
    "strange": packed("control", **CONTROL, **{"\x1b[2J": 1}),
    "intent": packed("control", **CONTROL, intent=[1]),
    "half": packed("control", **CONTROL, intent=["??"]).replace(b"??", b"\xc3\x28"),
    "deep": b"\x81\xa1x" + b"\x91" * (MOST_BYTES - 64) + b"\xc0",
    "deep map": b"\x81" * (MOST_BYTES - 64),
    "many": b"\xdf\xff\xff\xff\xff" + b"\xa1a\xc0" * 1000,
    "many names": packed("control", **CONTROL, intent=0)[:-1] + b"\xdd\xff\xff\xff\xff",
    "long name": packed("control", **CONTROL, intent=0)[:-1] + b"\x91\xdb\xff\xff\xff\xff",
    "long array": packed("control", **CONTROL, plan=["<f8", [1, 2], 0])[:-1] + b"\xc6\xff\xff\xff\xff",
    "short array": packed("control", **CONTROL, plan=["<f8", [2, 2], bytes(16)]),
    "huge array": packed("control", **CONTROL, plan=["<f8", [1 << 60, 1 << 60], b""]),
    "negative": packed("control", **CONTROL, plan=["<f8", [-1, 2], bytes(16)]),
    "many sides": packed("control", **CONTROL, plan=["<f8", [1] * 100, bytes(8)]),
    "objects": packed("control", **CONTROL, plan=["|O8", [1, 2], bytes(16)]),
    "plan": packed("control", **CONTROL, plan=bytes(16)),
    "hello": packed("hello", protocol=5),
    "done": packed("done"),
}


@pytest.mark.parametrize("body", HOSTILE.values(), ids=HOSTILE)
def test_what_is_no_command_of_the_protocol_is_refused_and_costs_nothing(body: bytes) -> None:
    assert len(body) <= MOST_BYTES
    tracemalloc.start()
    try:
        with pytest.raises(ProtocolError) as refused:
            read_command(read_answer(body))
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()
    assert str(refused.value).isprintable()


def test_sixty_thousand_spoilt_answers_are_read_or_refused() -> None:
    whole = [
        command_message(output)[HEAD.size :]
        for output in (
            tsbench.Control(1.0, 0.5, ("edge", "straße")),
            tsbench.Control(1.0, 0.5, (), np.ones((4, 2))),
            tsbench.Trajectory(np.arange(1.0, 4.0), np.ones((3, 3), dtype=np.float32), ("a",)),
            None,
        )
    ] + [packed("hello", protocol=5, name="mine", weights_file=None), packed("failed", reason="a", detail="b")]
    rng = random.Random(0)
    read = refused = 0
    for _ in range(60_000):
        body = bytearray(rng.choice(whole))
        for _ in range(rng.randint(1, 4)):
            at = rng.randrange(len(body) + 1)
            spoilt = rng.randbytes(rng.randint(0, 3))
            body[at : at + rng.randint(0, 3)] = spoilt
        try:
            output = read_command(read_answer(bytes(body)))
        except (ProtocolError, PlannerOutputError):
            refused += 1
        else:
            assert isinstance(output, tsbench.Control | tsbench.Trajectory)
            read += 1
    assert read > 1000
    assert refused > 1000
