"""Lanes that a plate reserves, as a navigation sees them that does not know the plate.

A phone knows the lanes of a road, but neither who may use them nor that one was turned round. So a reserved lane beside
lanes for cars counts as one of them, and a contraflow lane straight ahead of a lane that ends counts as its
continuation. Source: docs/scenes.md, "Reserved lanes" (all planners get the hint that leads through it).
Units: m, rad.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from tsbench.geometry.polyline import Polyline
from tsbench.roads.network import Lane, RoadNetwork

_USERS = ("bus", "bicycle")
# How far across a junction, and how far aside (as a share of its width), a lane still goes straight on.
_ACROSS_M = 20.0
_ASIDE_SHARE = 0.5


@dataclass(frozen=True, slots=True)
class ContraflowLane:
    """A contraflow lane, driven against its own direction.

    lane: its index. entry: index of the lane that it seems to continue. host: the edge beside it, which it seems to be
    a lane of; order: as which one. line: its centre line in the direction of the host.
    """

    lane: int
    entry: int
    host: str
    order: int
    line: Polyline


def open_lanes(network: RoadNetwork) -> frozenset[int]:
    """Ordinary lanes that are part of a road for cars, those reserved for buses or cyclists included."""
    found = set()
    for edge in network.edges.values():
        lanes = [network.lanes[i] for i in edge.lanes]
        if not edge.internal and any(lane.permits("passenger") for lane in lanes):
            found |= {lane.index for lane in lanes if lane.permits("passenger") or is_reserved(lane)}
    return frozenset(found)


def contraflow_lanes(network: RoadNetwork) -> dict[int, ContraflowLane]:
    """The contraflow lanes of a network, by index."""
    found: dict[int, ContraflowLane] = {}
    for contra in network.lanes:
        if contra.internal or not is_reserved(contra):
            continue
        edge = network.edges[contra.edge]
        beside = [
            e.id for e in network.edges.values() if (e.source, e.target) == (edge.target, edge.source) and e.source
        ]
        for before in (e for e in network.edges.values() if e.target == edge.target and e.id != edge.id):
            last = network.lanes[before.lanes[-1]]
            if beside and last.permits("passenger") and _straight_on(last, contra, network):
                line = Polyline(contra.line.points[::-1])
                found[contra.index] = ContraflowLane(contra.index, last.index, beside[0], last.order, line)
    return found


def is_reserved(lane: Lane) -> bool:
    """Is a lane for buses or cyclists, and not for cars?"""
    return not lane.permits("passenger") and any(lane.permits(user) for user in _USERS)


def _straight_on(before: Lane, contra: Lane, network: RoadNetwork) -> bool:
    """Does a lane end where the contraflow lane comes to meet it?"""
    if network.outgoing[before.index]:
        return False
    s, d = before.line.project(*contra.line.point_at(contra.line.length))
    turn = before.line.heading_at(before.line.length) - contra.line.heading_at(contra.line.length)
    ahead = 0.0 <= s - before.line.length + _ASIDE_SHARE <= _ACROSS_M
    return ahead and abs(d) <= _ASIDE_SHARE * before.width and math.cos(turn) < -0.5
