"""Other road users as a planner sees them: who they are and where they will go is left out.

Their ids count them as they come into sight, the nearest first; of their routes a turn signal is left.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from tsbench.geometry.angles import RIGHT, STRAIGHT, U_TURN, turn_class
from tsbench.roads.lane_graph import heading_change
from tsbench.roads.network import RoadNetwork
from tsbench.roads.planner_map import PlannerMap
from tsbench.sim.world import Actors, Agents, EgoState, Indicator

# Drivers signal so far before they turn, and while they turn.
SIGNAL_M = 50.0

Scalar = TypeVar("Scalar", bound=np.generic)
# Of a road user: on which of SUMO's lanes it signals, from which arc length on.
_Signals = dict[int, tuple[Indicator, float]]


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
