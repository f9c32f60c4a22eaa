"""Intersections of a crop and its lanes' neighbours of the other direction, as CommonRoad has them. Units: m."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from lxml.builder import E

from tsbench.report.export.elements import Element
from tsbench.report.export.pieces import Piece
from tsbench.roads.network import Lane, RoadNetwork

# Two roads meet everywhere where a street has another name; a junction has three arms.
_LEAST_ARMS = 3
_SUCCESSORS = {"r": "Right", "R": "Right", "s": "Straight", "l": "Left", "L": "Left"}
_ORDER = ("Right", "Straight", "Left")
# Bounds of both directions that are one line: so far from each other at most, at this many places.
_ONE_LINE_M, _PLACES = 0.6, 8


def intersections(
    network: RoadNetwork, cut: Mapping[int, tuple[Piece, ...]], free_ids: Iterator[int]
) -> Iterator[Element]:
    """Every junction of three arms or more: of each arm the lanelets that lead in, and where they lead by turns.

    cut: by lane index. free_ids: for intersections and their arms. A turn back has no place in the format.
    """
    for junction in sorted(network.junctions):
        edges = [e for e in network.edges.values() if not e.internal and junction in (e.source, e.target)]
        driven = [e for e in edges if any(network.lanes[i].permits("passenger") for i in e.lanes)]
        if len({e.source if e.target == junction else e.target for e in driven}) < _LEAST_ARMS:
            continue
        arms = [
            E.incoming(*parts, id=str(next(free_ids)))
            for edge in driven
            if edge.target == junction and (parts := _arm(network, edge.lanes, cut))
        ]
        if arms:
            yield E.intersection(*arms, id=str(next(free_ids)))


def _arm(network: RoadNetwork, lanes: tuple[int, ...], cut: Mapping[int, tuple[Piece, ...]]) -> list[Element]:
    """Lanelets of an arm, and those that follow on them, right to left; empty where none leads on."""
    leading, found = [], {name: set[int]() for name in _ORDER}
    for index in lanes:
        links = [c for c in network.outgoing[index] if c.direction in _SUCCESSORS]
        if index in cut and links:
            leading.append(cut[index][-1].lanelet)
        for c in links:
            after = next((i for i in (*c.via, c.to_lane) if i in cut), None)
            if after is not None:
                found[_SUCCESSORS[c.direction]].add(cut[after][0].lanelet)
    parts = [E.incomingLanelet(ref=str(ref)) for ref in leading]
    for name, refs in found.items():
        parts += [E(f"successors{name}", ref=str(ref)) for ref in sorted(refs)] if leading else []
    return parts


def opposite_lanes(network: RoadNetwork) -> dict[int, int]:
    """By index of an innermost lane: the innermost lane of the other direction, where both share a bound."""
    by_ends = {(e.source, e.target): e for e in network.edges.values() if not e.internal}
    found = {}
    for (source, target), edge in by_ends.items():
        back = by_ends.get((target, source))
        if back is None:
            continue
        lane, other = (network.lanes[e.lanes[-1]] for e in (edge, back))
        if _share_a_bound(lane, other, network.to_kerb):
            found[lane.index] = other.index
    return found


def _share_a_bound(lane: Lane, other: Lane, kerb: float) -> bool:
    ours, theirs = (_inner_bound(one, kerb) for one in (lane, other))
    return bool(np.hypot(*(ours - theirs[::-1]).T).max() <= _ONE_LINE_M)


def _inner_bound(lane: Lane, kerb: float) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Places on the bound away from the kerb, evenly along the lane."""
    share = np.linspace(0.0, lane.line.length, _PLACES).tolist()
    return np.array([lane.line.point_at(s, -kerb * lane.width / 2) for s in share])
