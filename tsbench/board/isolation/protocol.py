"""The protocol between the referee and an isolated planner: MessagePack over a stream socket.

A message is `<u4 size`, and then a body of that many bytes: a map of a message's fields and its `kind`. What planners
are given has the fields of their own dataclasses. An array is `[dtype, shape, bytes]`, in the order of C.
`docs/isolation.schema.json` says the same for programs.
"""

from __future__ import annotations

import math
import struct
from typing import Annotated, Any, Final, Literal

import msgspec
import numpy as np

from tsbench.core.text import one_line
from tsbench.geometry.polyline import Array, Polyline
from tsbench.planners.observation import SignView
from tsbench.roads.lane_graph import Destination, RoutePath
from tsbench.roads.network import Connection, Edge, Junction, Lane
from tsbench.roads.road_map import Crossing, MapConnection, MapEdge, MapJunction, MapLane
from tsbench.signs.annotations import SignInstance
from tsbench.sim.scene import Obstacle
from tsbench.sim.world import ActorTable, Agents, EgoState, WorldSnapshot

VERSION: Final = 5
# The descriptor that a planner's program finds it on.
LINE: Final = 3
HEAD = struct.Struct("<I")
# More than any command has; an observation or a map may be larger, and comes from the referee.
MOST_BYTES: Final = 1 << 20


class ProtocolError(Exception):
    """What came is no message of the protocol."""


class Message(
    msgspec.Struct, forbid_unknown_fields=True, tag_field="kind", tag=lambda name: name.removesuffix("Message").lower()
):
    """Base of all."""


class MapMessage(Message):
    """Before a context of another map than the last one's."""

    lanes: tuple[MapLane, ...]
    edges: tuple[MapEdge, ...]
    connections: tuple[MapConnection, ...]
    junctions: tuple[MapJunction, ...]
    crossings: tuple[Crossing, ...]
    left_hand: bool


class NetworkMessage(Message):
    """In its place for privileged planners: SUMO's network, the source of the map."""

    lanes: tuple[Lane, ...]
    edges: tuple[Edge, ...]
    connections: tuple[Connection, ...]
    junctions: tuple[Junction, ...]
    crossings: tuple[Crossing, ...]
    left_hand: bool
    class_speed: dict[str, float]


class ContextMessage(Message):
    """An episode begins. signs: the targets, for privileged planners only; params: of each its own, as texts."""

    seed: int
    destination: Destination
    dt: float
    signs: tuple[SignInstance, ...] = ()
    params: tuple[dict[str, str], ...] = ()


class ObservationMessage(Message):
    """A tick. route: s, d, remaining. path: where it is another one than before. truth: for privileged planners only.

    truth.actors.table: of road users that were not told of yet, id, kind, length, width, route.
    """

    step: int
    time: float
    ego: EgoState
    history: Array
    route: tuple[float, float, float]
    path: RoutePath | None
    actors: Agents
    signs: tuple[SignView, ...]
    obstacles: tuple[Obstacle, ...]
    truth: WorldSnapshot | None


class EndMessage(Message):
    """An episode has ended."""


class Floats(msgspec.Struct, array_like=True, forbid_unknown_fields=True):
    """An array in a planner's answer."""

    dtype: Literal["<f8", "<f4"]
    shape: Annotated[tuple[Annotated[int, msgspec.Meta(ge=0, le=MOST_BYTES)], ...], msgspec.Meta(max_length=2)]
    data: bytes

    def array(self) -> Array:
        """It, read-only. Raises ProtocolError."""
        dtype = np.dtype(self.dtype)
        if len(self.data) != dtype.itemsize * math.prod(self.shape):
            raise ProtocolError(f"an array of shape {self.shape} in {len(self.data)} bytes")
        return np.ndarray(self.shape, dtype, self.data)


class HelloMessage(Message):
    """What a planner says of itself, once; problem: why it cannot be driven."""

    protocol: int
    name: str = ""
    privileged: bool = False
    sign_access: bool = True
    floor: bool = False
    weights_file: str | None = None
    forks: bool = False
    keeps_process: bool = False
    problem: str = ""


class DoneMessage(Message):
    """The answer to a context, and to an end."""


class ControlMessage(Message):
    """A command, as `planners.base.Control`."""

    acceleration: float
    steering: float
    intent: tuple[str, ...] = ()
    plan: Floats | None = None


class TrajectoryMessage(Message):
    """A command, as `planners.base.Trajectory`."""

    times: Floats
    poses: Floats
    intent: tuple[str, ...] = ()


class InvalidMessage(Message):
    """Why what the planner returned is no command."""

    reason: str


class FailedMessage(Message):
    """In place of any answer: what the planner raised, and its traceback."""

    reason: str
    detail: str = ""


Asked = MapMessage | NetworkMessage | ContextMessage | ObservationMessage | EndMessage
Answer = HelloMessage | DoneMessage | ControlMessage | TrajectoryMessage | InvalidMessage | FailedMessage


def plain(value: Any) -> Any:
    """What MessagePack has for it: for arrays, numbers of NumPy's and lines."""
    if type(value) is np.ndarray:
        return value.dtype.str, value.shape, value.tobytes()
    if type(value) is Polyline:
        return value.points
    if isinstance(value, np.generic):
        return value.item()
    raise NotImplementedError(f"no message holds {type(value).__name__}")


def rich(kind: Any, told: Any) -> Any:
    """From what `plain` gave.

    An array lies in the memory of its own bytes, at a multiple of 16 as any that is freshly allocated: sums of arrays
    then have the same bits wherever the arrays come from. It is read-only.
    """
    dtype, shape, data = told
    array = np.ndarray(shape, dtype, data)
    return Polyline(array) if kind is Polyline else array


_ENCODER = msgspec.msgpack.Encoder(enc_hook=plain)
_ANSWERS = msgspec.msgpack.Decoder(Answer)


def frame(message: Message, encoder: msgspec.msgpack.Encoder = _ENCODER) -> bytes:
    """A message as it passes over the line."""
    body = encoder.encode(message)
    return HEAD.pack(len(body)) + body


def read_answer(body: bytes) -> Answer:
    """Raises ProtocolError: nothing of a planner's is trusted."""
    try:
        answer: Answer = _ANSWERS.decode(body)
    except (ValueError, RecursionError) as problem:
        raise ProtocolError(one_line(str(problem))) from None
    return answer


def schema() -> dict[str, Any]:
    """The protocol for programs, as JSON Schema: bytes, for which JSON has no type, are MessagePack's."""
    array = {"prefixItems": [{"enum": ["<f8", "<f4", "<i4", "|i1"]}, {"items": {"type": "integer"}}, {}]}
    row = {"prefixItems": [{"type": kind} for kind in ("string", "integer", "number", "number", "array")]}
    _, parts = msgspec.json.schema_components(
        (Asked, Answer),
        schema_hook=lambda kind: {"type": "array", **({"items": row} if kind is ActorTable else array)},
        ref_template="#/$defs/{name}",
    )
    return {"protocol": VERSION, "$defs": parts}
