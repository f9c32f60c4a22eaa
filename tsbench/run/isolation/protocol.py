"""The protocol between the referee and an isolated planner: messages of flat arrays over a stream socket.

A message is `<u4 size, u4 kind>` and then, `size` bytes in all, the fields of its kind in the order of `MESSAGES`; a
field is `<u4 count>` and so many items. Everything is little-endian and nothing is aligned. A list of names is one text
with a line for each. `docs/isolation.schema.json` says the same for programs (`tsbench planners protocol`).
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Any, Final

import numpy as np

VERSION: Final = 1
HEAD = struct.Struct("<II")
# More than any command has; an observation or a map may be larger, and comes from the referee.
MOST_BYTES: Final = 1 << 20

F8, I4, TEXT = "f8", "i4", "text"
_DTYPES: Mapping[str, np.dtype[Any]] = {F8: np.dtype("<f8"), I4: np.dtype("<i4")}
_COUNT = struct.Struct("<I")


class Kind(IntEnum):
    """What a message is. From the planner's side come CELL, HELLO, DONE, CONTROL, TRAJECTORY, INVALID and FAILED."""

    CELL = 1
    HELLO = 2
    MAP = 3
    CONTEXT = 4
    ROUTE = 5
    TRUTH = 6
    OBSERVATION = 7
    DONE = 8
    CONTROL = 9
    TRAJECTORY = 10
    INVALID = 11
    FAILED = 12


Field = tuple[str, str, str]

# (name, items, what it holds). m, s, m/s, rad; a number that is not there is NaN; -1 = no lane.
MESSAGES: Mapping[Kind, tuple[Field, ...]] = {
    Kind.CELL: (("effects", TEXT, "JSON: what of the cell took effect"),),
    Kind.HELLO: (
        (
            "facts",
            TEXT,
            "JSON: protocol (1), name, privileged, sign_access, floor, weights_sha256; or problem",
        ),
    ),
    Kind.MAP: (
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
    Kind.CONTEXT: (
        ("seed", TEXT, "a whole number"),
        ("names", TEXT, "edge of the destination"),
        ("numbers", F8, "arc length of the destination on it, seconds a tick"),
        ("sign", TEXT, "JSON, for privileged planners only: the target"),
    ),
    Kind.ROUTE: (
        ("edges", TEXT, "edge ids in order"),
        ("points", F8, "of the reference line, x y"),
        ("piece_lanes", I4, "p lanes"),
        ("pieces", F8, "p x 2: arc lengths at which each begins and ends"),
        ("limits", F8, "q x 2: arc length, speed limit from there on"),
        ("destination", F8, "arc length of the destination"),
    ),
    Kind.TRUTH: (
        ("ego_lane", I4, "lane, on the road?"),
        ("ego", F8, "as in OBSERVATION"),
        ("new", TEXT, "JSON: road users that were not told of yet: id, kind, length, width, route"),
        ("index", I4, "n x 2: which road user, lane"),
        ("actors", F8, "n x 5: x, y, heading, speed, arc length of the front on the lane"),
    ),
    Kind.OBSERVATION: (
        ("clock", F8, "step, time"),
        ("ego", F8, "x, y, heading, speed, acceleration, steering, yaw rate, s, d"),
        ("ego_lane", I4, "lane, on the road?"),
        ("history", F8, "h x 4: x, y, heading, speed, oldest first"),
        ("route", F8, "s, d, remaining m, on the line of the last ROUTE"),
        (
            "actor_words",
            I4,
            "n x 4: id, kind (car bus bicycle pedestrian), lane, indicator (none left right)",
        ),
        ("actors", F8, "n x 6: x, y, heading, speed, length, width"),
        ("sign_names", TEXT, "m codes, then m edges"),
        ("sign_lanes", I4, "m: lane of the edge, -1 = all"),
        ("signs", F8, "m x 6: value, x, y, heading, arc length, distance"),
        ("obstacle_names", TEXT, "k ids, then k shapes, then k lanes"),
        ("obstacles", F8, "k x 5: x, y, heading, length, width"),
    ),
    Kind.DONE: (),
    Kind.CONTROL: (
        ("numbers", F8, "acceleration, steering"),
        ("intent", TEXT, "edge ids, may be empty"),
        ("has_plan", I4, "1 where a plan follows"),
        ("plan", F8, "k x 2: x, y"),
    ),
    Kind.TRAJECTORY: (
        ("single", I4, "2: were the times, were the poses of single precision?"),
        ("times", F8, "k"),
        ("poses", F8, "k x 3: x, y, heading"),
        ("intent", TEXT, "edge ids, may be empty"),
    ),
    Kind.INVALID: (("reason", TEXT, "why what the planner returned is no command"),),
    Kind.FAILED: (("reason", TEXT, "what the planner raised"), ("detail", TEXT, "its traceback")),
}


class ProtocolError(Exception):
    """What came is no message of the protocol."""


def pack(kind: Kind, *fields: Any) -> bytes:
    """A message; arrays of the field's kind (any shape), text as str."""
    parts = [b""]
    for (_, item, _), value in zip(MESSAGES[kind], fields, strict=True):
        if item == TEXT:
            data = value.encode()
            parts += (_COUNT.pack(len(data)), data)
        else:
            array = np.asarray(value, _DTYPES[item])
            parts += (_COUNT.pack(array.size), array.tobytes())
    body = b"".join(parts)
    return HEAD.pack(len(body), kind) + body


def unpack(kind: Kind, body: bytes) -> list[Any]:
    """The fields of a message: flat read-only arrays, and texts. Raises ProtocolError."""
    found: list[Any] = []
    at = 0
    try:
        for _, item, _ in MESSAGES[kind]:
            (count,) = _COUNT.unpack_from(body, at)
            at += 4
            if item == TEXT:
                if len(body) < at + count:
                    raise ProtocolError("a field is cut short")
                found.append(body[at : at + count].decode())
                at += count
            else:
                found.append(np.frombuffer(body, _DTYPES[item], count, at))
                at += count * _DTYPES[item].itemsize
    except (struct.error, ValueError, UnicodeDecodeError) as problem:
        raise ProtocolError(f"{kind.name}: {problem}") from None
    if at != len(body):
        raise ProtocolError(f"{kind.name}: {len(body) - at} bytes too many")
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
        "field": "u4 count, then the items; little-endian, no padding; text is UTF-8, its count is bytes",
        "messages": {
            kind.name: {
                "kind": int(kind),
                "fields": [{"name": name, "items": item, "holds": holds} for name, item, holds in fields],
            }
            for kind, fields in MESSAGES.items()
        },
    }
