"""Other road users as a planner sees them: who they are and where they will go is left out.

Their ids count them as they come into sight, the nearest first; of their routes a turn signal is left.

All that a sign-blind planner is given, as bytes: equal bytes force equal behaviour.

Everything that can be reached from a context and an observation is in them: fields, slots, attributes, arrays, ids,
mappings in their order. Of plates only what masking leaves is.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from enum import Enum
from itertools import pairwise
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from tsbench.core.frozen import Frozen
from tsbench.geometry.elementary import RIGHT, STRAIGHT, U_TURN, turn_class
from tsbench.planners.base import PlannerContext
from tsbench.planners.observation import Observation, SignView
from tsbench.roads.lane_graph import heading_change
from tsbench.roads.network import RoadNetwork
from tsbench.roads.planner_map import PlannerMap
from tsbench.sim.world import Actors, Agents, EgoState, Indicator

# Drivers signal so far before they turn, and while they turn.
SIGNAL_M = 50.0

Scalar = TypeVar("Scalar", bound=np.generic)
# Of a road user: on which of SUMO's lanes it signals, from which arc length on.
_Signals = dict[int, tuple[Indicator, float]]


# Words in scene files that name the part or place of a road user: none of them may reach a planner.
_ROLES = re.compile(
    r"convoy|walker|leader|target|distractor|contra|compliant|obedient|priority|sign_|path_|\bbg|cut\d|\.xml|/",
    re.IGNORECASE,
)


class TrafficView:
    """Turns the road users of one episode's ticks into what is seen of them; to be shown every tick, in order."""

    def __init__(self, network: RoadNetwork, view: PlannerMap) -> None:
        self._network, self._lane_of = network, view.lane_of
        self._ids: dict[int, int] = {}
        self._signals: dict[int, _Signals] = {}
        self._rows: list[int] = []
        self._order: list[int] = []
        self._same = tuple(_fixed(np.empty(0, dtype=kind)) for kind in (np.int32, float, float, np.int8))

    def see(self, actors: Actors, ego: EgoState) -> Agents:
        """Everybody in sight at a tick."""
        rows = actors.index.tolist()
        if rows != self._rows:
            self._remember(actors, rows, ego)
        order, boxes = self._order, actors.boxes
        signals, lanes, places = self._signals, actors.lane.tolist(), actors.lane_s.tolist()
        shown = [Indicator.NONE] * len(rows)
        for k, row in enumerate(rows):
            signal = signals[row].get(lanes[k])
            if signal is not None and places[k] >= signal[1]:
                shown[k] = signal[0]
        ids, length, width, kind = self._same
        return Agents(
            ids=ids,
            pose=_fixed(actors.pose[order]),
            speed=_fixed(actors.speed[order]),
            length=length,
            width=width,
            kind=kind,
            lane=_fixed(self._lane_of[actors.lane[order]]),
            indicator=_fixed(np.array([shown[k] for k in order], dtype=np.int8)),
            boxes=tuple([boxes[k] for k in order]),
        )

    def _remember(self, actors: Actors, rows: list[int], ego: EgoState) -> None:
        """The road users in sight, until that changes."""
        pose, table = actors.pose.tolist(), actors.table
        new = [
            (math.hypot(x - ego.x, y - ego.y), x, y, row)
            for (x, y, _), row in zip(pose, rows, strict=True)
            if row not in self._ids
        ]
        for *_, row in sorted(new):
            self._ids[row] = len(self._ids)
            self._signals[row] = self._signalled(table.routes[row])
        ids = [self._ids[row] for row in rows]
        self._rows, self._order = rows, sorted(range(len(rows)), key=ids.__getitem__)
        index = actors.index[self._order]
        self._same = (
            _fixed(np.array(sorted(ids), dtype=np.int32)),
            _fixed(table.length[index]),
            _fixed(table.width[index]),
            _fixed(table.kind[index]),
        )

    def _signalled(self, route: tuple[str, ...]) -> _Signals:
        network, found = self._network, _Signals()
        for edge, after in pairwise(route):
            turn = turn_class(math.degrees(heading_change(network, edge, after)))
            if turn == STRAIGHT:
                continue
            # A vehicle that turns round signals to the middle of the road.
            to_right = network.left_hand if turn == U_TURN else turn == RIGHT
            side = Indicator.RIGHT if to_right else Indicator.LEFT
            for lane in network.edge_lanes(edge):
                found.setdefault(lane.index, (side, lane.length - SIGNAL_M))
                for connection in network.outgoing[lane.index]:
                    if network.lanes[connection.to_lane].edge == after:
                        found.update((via, (side, 0.0)) for via in connection.via)
        return found


def _fixed(array: npt.NDArray[Scalar]) -> npt.NDArray[Scalar]:
    array.setflags(write=False)
    return array


def blind_bytes(context: PlannerContext, observation: Observation) -> bytes:
    """What is reachable from both, plates masked, in canonical form.

    Raises TypeError for an object of a kind that is not known here or that could be written into, ValueError for a
    text that names a role, and for an expert's view.
    """
    if context.privilege is not None or observation.truth is not None:
        raise ValueError("this is what an expert is given: it is not blind")
    writer = _Writer()
    writer.write(context, "context")
    writer.write(observation, "observation")
    return b"".join(writer.out)


class _Writer:
    def __init__(self) -> None:
        self.out: list[bytes] = []
        self._seen: dict[int, int] = {}
        # Of what was written nothing may go, or its `id` would be given anew.
        self._held: list[object] = []

    def write(self, thing: object, where: str) -> None:
        """One object and all behind it; `where`: how it is reached."""
        if isinstance(thing, SignView):
            thing = thing.masked()
        kind = type(thing)
        self.out.append(kind.__qualname__.encode() + b"\0")
        if thing is None or kind in (bool, int, float, str):
            self._plain(thing, where)
        elif isinstance(thing, np.generic):
            self.out.append(thing.dtype.str.encode() + thing.tobytes())
        elif id(thing) in self._seen:
            self.out.append(b"@%d\0" % self._seen[id(thing)])
        else:
            self._seen[id(thing)] = len(self._seen)
            self._held.append(thing)
            self._compound(thing, where)

    def _plain(self, thing: Any, where: str) -> None:
        if isinstance(thing, str) and (role := _ROLES.search(thing)):
            raise ValueError(f"{where}: {thing!r} names a part ({role.group()!r})")
        data = struct.pack("<d", thing) if isinstance(thing, float) else repr(thing).encode()
        self.out.append(b"%d:%b" % (len(data), data))

    def _compound(self, thing: Any, where: str) -> None:
        if isinstance(thing, np.ndarray):
            _check_array(thing, where)
            self.out.append(f"{thing.dtype.str}{thing.shape}".encode() + thing.tobytes())
        elif isinstance(thing, Enum):
            self.write(thing.value, where)
        elif type(thing) is tuple:
            self._all(((f"[{k}]", one) for k, one in enumerate(thing)), len(thing), where)
        elif type(thing) is frozenset:
            self._all(((f"{{{one}}}", one) for one in sorted(thing)), len(thing), where)
        elif type(thing) is MappingProxyType:
            pairs = [
                part
                for k, (key, value) in enumerate(thing.items())
                for part in ((f".key{k}", key), (f"[{key!r}]", value))
            ]
            self._all(iter(pairs), len(pairs), where)
        elif isinstance(thing, Frozen) or _is_frozen(thing):
            names = _attributes(thing)
            self._all(((f".{name}", getattr(thing, name)) for name in names), len(names), where)
        else:
            raise TypeError(f"{where}: a {type(thing).__qualname__} can be written into, or is not known here")

    def _all(self, parts: Iterator[tuple[str, object]], count: int, where: str) -> None:
        self.out.append(b"%d(" % count)
        for name, part in parts:
            self.write(part, where + name)


def _is_frozen(thing: Any) -> bool:
    parameters = getattr(type(thing), "__dataclass_params__", None)
    return parameters is not None and bool(parameters.frozen)


def _check_array(array: Any, where: str) -> None:
    base = array
    while base is not None:
        if not isinstance(base, np.ndarray) or base.dtype.hasobject or base.flags.writeable:
            raise TypeError(f"{where}: an array that can be written into, or holds objects")
        base = base.base


def _attributes(thing: Any) -> list[str]:
    """Names of all that an object holds: fields, slots of its classes, and what else stands in its `__dict__`."""
    names = {f.name for f in fields(thing)} if is_dataclass(thing) else set()
    for kind in type(thing).__mro__:
        slots = kind.__dict__.get("__slots__", ())
        names |= {slots} if isinstance(slots, str) else set(slots)
    return sorted(names | set(getattr(thing, "__dict__", ())))
