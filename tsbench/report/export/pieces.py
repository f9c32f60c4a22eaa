"""Lanes as lanelets, cut where a speed begins or ends to hold: CommonRoad's plates hold for whole lanelets.

Positions are metres from the start of a lane.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

from tsbench.roads.network import RoadNetwork
from tsbench.signs.annotations import SignInstance
from tsbench.signs.plate_params import ReservedLaneParams, ZoneParams
from tsbench.sim.scene import Scene

# Internal lanes where two roads only touch have no extent, and no direction either.
SHORTEST_M = 0.05
# Plates that ask a speed from their line on; all others mean the whole road that they stand at.
_SPEEDS = frozenset({"3.24", "4.6", "5.21", "5.31"})


@dataclass(frozen=True)
class Piece:
    """A lanelet: its id, the part of its lane from `begins` to `ends`, and the plates (ids in the scene) held there."""

    lanelet: int
    begins: float
    ends: float
    plates: tuple[str, ...]


def lane_ids(network: RoadNetwork) -> dict[int, int]:
    """The lanelet at each lane's end, positive, by lane index; lanes without extent have none."""
    return {lane.index: lane.index + 1 for lane in network.lanes if lane.line.length >= SHORTEST_M}


def pieces(scene: Scene, free_ids: Iterator[int]) -> dict[int, tuple[Piece, ...]]:
    """Each lane's lanelets along it, by lane index. free_ids: for all but each lane's last, which `lane_ids` has."""
    network, found = scene.network, {}
    stretches: dict[int, list[tuple[str, float, float]]] = {}
    for sign in scene.signs:
        for index, begins, ends in _holds(network, sign, scene.signs):
            stretches.setdefault(index, []).append((sign.id, begins, ends))
    for index, lanelet in lane_ids(network).items():
        length = network.lanes[index].line.length
        held = stretches.get(index, [])
        marks = _apart([at for _, *both in held for at in both], length)
        bounds = [0.0, *marks, length]
        ids = [*(next(free_ids) for _ in marks), lanelet]
        found[index] = tuple(
            Piece(one, begins, ends, tuple(sign for sign, a, b in held if a < (begins + ends) / 2 < b))
            for one, (begins, ends) in zip(ids, pairwise(bounds), strict=True)
        )
    return found


def _apart(marks: list[float], length: float) -> list[float]:
    """The marks inside a lane in their order, without what would leave a lanelet without extent."""
    kept: list[float] = []
    for mark in sorted(marks):
        if mark - (kept[-1] if kept else 0.0) > SHORTEST_M and mark < length - SHORTEST_M:
            kept.append(mark)
    return kept


def _holds(
    network: RoadNetwork, sign: SignInstance, signs: tuple[SignInstance, ...]
) -> Iterator[tuple[int, float, float]]:
    """Lane, begin and end of each stretch for which a plate holds."""
    if sign.code not in _SPEEDS:
        for index in _lanes(network, sign.edge, sign.lane):
            yield index, 0.0, network.lanes[index].line.length
        return
    zone = isinstance(sign.params, ZoneParams) and not isinstance(sign.params, ReservedLaneParams)
    edges = sign.params_as(ZoneParams).zone_edges if zone else (sign.edge,)
    last = next((plate for plate in signs if plate.ends == sign.id), None)
    for edge in edges:
        begins = sign.position_m if edge == sign.edge else 0.0
        ends = last.position_m if last is not None and last.edge == edge else math.inf
        for index in _lanes(network, edge, sign.lane):
            length = network.lanes[index].line.length
            # A plate at its road's very end is that road's, or it would be nobody's.
            yield index, begins if begins < length - SHORTEST_M else 0.0, min(ends, length)
        if math.isfinite(ends):
            return


def _lanes(network: RoadNetwork, edge: str, lane: int) -> tuple[int, ...]:
    lanes = network.edges[edge].lanes
    return lanes if lane < 0 or lane >= len(lanes) else (lanes[lane],)
