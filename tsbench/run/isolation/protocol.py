"""The protocol between the referee and an isolated planner: messages of flat arrays over a stream socket.

A message is `<u4 size, u4 kind`, and then `size` bytes: a u4 count of items for each field of its kind, in the order of
`MESSAGES`, then the items of each. Counts and each field's items are filled up with zeros to a multiple of 16 bytes, so
that arrays can be used where they lie. Everything is little-endian. A list of names is one text with a line for each.
`docs/isolation.schema.json` says the same for programs.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Any, Final

import numpy as np

VERSION: Final = 3
# The descriptor that a planner's program finds it on.
LINE: Final = 3
HEAD = struct.Struct("<II")
# More than any command has; an observation or a map may be larger, and comes from the referee.
MOST_BYTES: Final = 1 << 20
# The alignment of freshly allocated memory: sums of arrays then have the same bits wherever the arrays come from.
ALIGNED: Final = 16

F8, I4, I1, TEXT = "f8", "i4", "i1", "text"
_DTYPES: Mapping[str, np.dtype[Any]] = {F8: np.dtype("<f8"), I4: np.dtype("<i4"), I1: np.dtype("i1")}
_LETTERS: Mapping[str, str] = {F8: "d", I4: "i", I1: "b"}


class MessageKind(IntEnum):
    """What a message is. From the planner's side come HELLO, DONE, CONTROL, TRAJECTORY, INVALID and FAILED."""

    HELLO = 2
    MAP = 3
    CONTEXT = 4
    ROUTE = 5
    ACTORS = 6
    SIGNS = 7
    OBSTACLES = 8
    TRUTH = 9
    OBSERVATION = 10
    DONE = 11
    CONTROL = 12
    TRAJECTORY = 13
    INVALID = 14
    FAILED = 15
    END = 16


Field = tuple[str, str, str]

# (name, items, what it holds). m, s, m/s, rad; a number that is not there is NaN; -1 = no lane.
MESSAGES: Mapping[MessageKind, tuple[Field, ...]] = {
    MessageKind.HELLO: (
        (
            "facts",
            TEXT,
            "JSON: protocol (2), name, privileged, sign_access, floor, weights_file, forks, keeps_process; or "
            "problem",
        ),
    ),
    MessageKind.MAP: (
        ("lane_ids", TEXT, "n ids"),
        ("lane_edges", TEXT, "n edge ids, empty for paths through junctions"),
        ("lane_places", I4, "n x 4: order (0 = rightmost), path through a junction?, left, right lane"),
        ("lane_sizes", F8, "n x 2: width, speed limit"),
        ("lane_counts", I4, "n: points of each line"),
        ("lane_points", F8, "all points, x y"),
        ("edge_names", TEXT, "e ids, then e source junctions, then e target junctions"),
        ("edge_counts", I4, "e x 2: number of lanes, internal?"),
        ("edge_lanes", I4, "lanes of each edge, rightmost first"),
        ("edge_lengths", F8, "e"),
        ("connection_counts", I4, "c x 3: from lane, to lane, number of path lanes"),
        ("connection_via", I4, "path lanes of each connection"),
        ("junction_ids", TEXT, "j ids"),
        ("junction_middles", F8, "j x 2: x, y"),
        ("junction_counts", I4, "j: points of each area"),
        ("junction_points", F8, "all points, x y"),
        ("crossing_ids", TEXT, "k ids"),
        ("crossing_edges", TEXT, "k lists of edge ids, with spaces between"),
        ("crossing_widths", F8, "k"),
        ("crossing_counts", I4, "k: points of each line"),
        ("crossing_points", F8, "all points, x y"),
        ("sumo", TEXT, "JSON, for privileged planners only: what SUMO's network says beyond a map"),
    ),
    MessageKind.CONTEXT: (
        ("seed", TEXT, "a whole number"),
        ("names", TEXT, "edge of the destination"),
        ("numbers", F8, "arc length of the destination on it, seconds a tick"),
        ("sign", TEXT, "JSON, for privileged planners only: the target"),
    ),
    MessageKind.ROUTE: (
        ("edges", TEXT, "edge ids in order"),
        ("points", F8, "of the reference line, x y"),
        ("piece_lanes", I4, "p lanes"),
        ("pieces", F8, "p x 2: arc lengths at which each begins and ends"),
        ("limits", F8, "q x 2: arc length, speed limit from there on"),
        ("destination", F8, "arc length of the destination"),
    ),
    MessageKind.ACTORS: (
        ("ids", I4, "n"),
        ("kinds", I1, "n: 0 car, 1 bus, 2 bicycle, 3 pedestrian"),
        ("lengths", F8, "n"),
        ("widths", F8, "n"),
    ),
    MessageKind.SIGNS: (
        ("names", TEXT, "m codes (empty: not seen from the front), then m edges, then m outlines"),
        ("lanes", I4, "m: lane of the edge, -1 = all"),
        ("numbers", F8, "m x 7: value, x, y, heading, arc length, two directions of the main road"),
    ),
    MessageKind.OBSTACLES: (
        ("names", TEXT, "k ids, then k shapes, then k lanes"),
        ("numbers", F8, "k x 5: x, y, heading, length, width"),
    ),
    MessageKind.TRUTH: (
        ("ego_lane", I4, "lane; what is not here is as in OBSERVATION"),
        ("ego", F8, "s, d on it"),
        ("new", TEXT, "JSON: road users that were not told of yet: id, kind, length, width, route"),
        ("index", I4, "n: which road user, counted as they were told of"),
        ("poses", F8, "n x 3: x, y, heading"),
        ("speeds", F8, "n"),
        ("lanes", I4, "n"),
        ("places", F8, "n: arc length of the front on the lane"),
    ),
    MessageKind.OBSERVATION: (
        (
            "numbers",
            F8,
            "step, time; of the ego x, y, heading, speed, acceleration, steering, yaw rate, s, d; on the line of the "
            "last ROUTE s, d, remaining m",
        ),
        ("ego_lane", I4, "lane, on the road?"),
        ("history", F8, "h x 4: x, y, heading, speed, oldest first"),
        ("poses", F8, "n x 3: x, y, heading of each of the last ACTORS"),
        ("speeds", F8, "n"),
        ("lanes", I4, "n"),
        ("indicators", I1, "n: 0 none, 1 left, 2 right"),
        ("distances", F8, "m: to each of the last SIGNS"),
    ),
    MessageKind.DONE: (),
    MessageKind.CONTROL: (
        ("numbers", F8, "acceleration, steering"),
        ("intent", TEXT, "edge ids, may be empty"),
        ("has_plan", I1, "1 where a plan follows"),
        ("plan", F8, "k x 2: x, y"),
    ),
    MessageKind.TRAJECTORY: (
        ("single", I1, "2: were the times, were the poses of single precision?"),
        ("times", F8, "k"),
        ("poses", F8, "k x 3: x, y, heading"),
        ("intent", TEXT, "edge ids, may be empty"),
    ),
    MessageKind.INVALID: (("reason", TEXT, "why what the planner returned is no command"),),
    MessageKind.FAILED: (("reason", TEXT, "what the planner raised"), ("detail", TEXT, "its traceback")),
    MessageKind.END: (),
}


class ProtocolError(Exception):
    """What came is no message of the protocol."""


# Of each kind: the item of each field, and what is before its items, with and without the head.
_ITEMS = {kind: tuple(item for _, item, _ in fields) for kind, fields in MESSAGES.items()}
_STARTS = {
    kind: struct.Struct(f"<II{len(items)}I{-4 * len(items) % ALIGNED}x") for kind, items in _ITEMS.items()
}
_COUNTS = {
    kind: struct.Struct(f"<{len(items)}I{-4 * len(items) % ALIGNED}x") for kind, items in _ITEMS.items()
}
_ZEROS = tuple(bytes(-size % ALIGNED) for size in range(ALIGNED))


def pack(kind: MessageKind, *fields: Any) -> bytes:
    """A message; arrays of the field's kind (any shape) or tuples of numbers, text as str."""
    counts, parts = [], [b""]
    for item, value in zip(_ITEMS[kind], fields, strict=True):
        if item == TEXT:
            # Half a character, in what a planner says, is no reason to say nothing.
            data = value.encode(errors="backslashreplace")
            counts.append(len(data))
        elif type(value) is tuple:
            data = struct.pack(f"<{len(value)}{_LETTERS[item]}", *value)
            counts.append(len(value))
        else:
            array = np.asarray(value, _DTYPES[item])
            data = array.tobytes()
            counts.append(array.size)
        parts += (data, _ZEROS[len(data) % ALIGNED])
    start = _STARTS[kind]
    parts[0] = start.pack(start.size - HEAD.size + sum(map(len, parts)), kind, *counts)
    return b"".join(parts)


def unpack(kind: MessageKind, body: bytes) -> list[Any]:
    """The fields of a message: flat read-only arrays, and texts. Raises ProtocolError."""
    found: list[Any] = []
    counts = _COUNTS[kind]
    at = counts.size
    try:
        for item, count in zip(_ITEMS[kind], counts.unpack_from(body), strict=True):
            if item == TEXT:
                size = count
                found.append(body[at : at + size].decode())
            else:
                dtype = _DTYPES[item]
                size = count * dtype.itemsize
                found.append(np.frombuffer(body, dtype, count, at))
            at += size + -size % ALIGNED
    except (struct.error, ValueError, UnicodeDecodeError) as problem:
        raise ProtocolError(f"{kind.name}: {problem}") from None
    if at != len(body):
        raise ProtocolError(f"{kind.name}: {len(body)} bytes, its counts say {at}")
    return found


def names(text: str, count: int) -> list[str]:
    """Lines of a text, of which there must be so many."""
    found = text.split("\n") if count else []
    if len(found) != count:
        raise ProtocolError(f"{len(found)} names where {count} belong")
    return found


def lines(items: Sequence[str]) -> str:
    return "\n".join(items)


def schema() -> dict[str, Any]:
    """The protocol for programs: messages by name with their numbers and fields."""
    return {
        "protocol": VERSION,
        "head": ["u4 size of the fields in bytes", "u4 kind"],
        "fields": "a u4 count for each field, then the items of each; counts and each field's items are filled up with "
        "zeros to a multiple of 16 bytes; little-endian; text is UTF-8, its count is bytes",
        "messages": {
            kind.name: {
                "kind": int(kind),
                "fields": [{"name": name, "items": item, "holds": holds} for name, item, holds in fields],
            }
            for kind, fields in MESSAGES.items()
        },
    }
