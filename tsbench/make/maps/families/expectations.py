"""What a crop must offer once it is built: the lint compares it with the finished network."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from tsbench.scenarios.map_pool import PoolRow

USED_LANE_M = 8.0
APPROACH_LANE_M = 63.0  # ego's front 60 m before the line, and a little behind it
CORRIDOR_LANE_M = 145.0


@dataclass(frozen=True)
class Expectations:
    """Least lane length by edge (metres), edge-to-edge links that must exist, turn classes of some links."""

    min_lane_m: dict[str, float]
    links: list[tuple[str, str]] = field(default_factory=list)
    turns: dict[tuple[str, str], str] = field(default_factory=dict)


def expectations(row: PoolRow) -> Expectations:
    return _BY_FAMILY[row.family](row, row.fields)


def _junction(_: PoolRow, detail: dict[str, Any]) -> Expectations:
    arms = detail["arms"]
    edges = [edge for arm in arms for edge in (arm["in_edge"], arm["out_edge"]) if edge]
    links = [
        (one["in_edge"], other["out_edge"])
        for one in arms
        for other in arms
        if one is not other and one["in_edge"] and other["out_edge"]
    ]
    return Expectations(dict.fromkeys(edges, USED_LANE_M), links)


def _roundabout(_: PoolRow, detail: dict[str, Any]) -> Expectations:
    ring = detail["ring"]
    links = list(pairwise([*ring, ring[0]]))
    # A leg is one edge of the crop, the one at the ring (maps.merge); others' queues on it must not reach the ring.
    legs = [leg["edges"][-1] for leg in detail["entries"]] + [leg["edges"][0] for leg in detail["exits"]]
    return Expectations(dict.fromkeys(legs, USED_LANE_M), links)


def _dual_path(row: PoolRow, detail: dict[str, Any]) -> Expectations:
    signed = detail["signed_edge"]
    ways = [[signed, *detail["short"]], [signed, *detail["compliant"]]]
    links = [link for way in ways for link in pairwise(way)]
    lanes = {edge: USED_LANE_M for way in ways for edge in way} | {signed: APPROACH_LANE_M}
    base, _, compliant = row.slot.partition("_")
    turns = {(signed, ways[0][1]): base, (signed, ways[1][1]): compliant}
    return Expectations(lanes, links, turns)


def _corridor(_: PoolRow, detail: dict[str, Any]) -> Expectations:
    edges = [edge for edge in (detail["edge"], detail["opposite"]) if edge]
    return Expectations(dict.fromkeys(edges, CORRIDOR_LANE_M))


_BY_FAMILY: dict[str, Callable[[PoolRow, dict[str, Any]], Expectations]] = {
    "junction": _junction,
    "roundabout": _roundabout,
    "dual_path": _dual_path,
    "corridor": _corridor,
}
