"""The legs of a ring: edges between it and the cut, entries and exits apart, and which of them are one arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsbench.make.maps.cut import EdgePiece
from tsbench.make.maps.lines import point_at
from tsbench.make.maps.source import SourceNetwork
from tsbench.make.maps.utm import Floats

# Outer ends this near to each other belong to one road: carriageways of a dual one lie 10-25 m apart.
SAME_ARM_M = 30.0
_SLIVER_M = 1.0


@dataclass(frozen=True, slots=True)
class Leg:
    """Edges between the ring and the cut, in driving order; `at` the ring node, `length` what is kept."""

    at: int
    rows: tuple[int, ...]
    length: float
    inwards: bool

    def outer_end(self, source: SourceNetwork) -> Floats:
        """Where it is cut, (2,) metres UTM."""
        rows = self.rows[::-1] if self.inwards else self.rows
        left = self.length
        for row in rows:
            line = source.line(row)[::-1] if self.inwards else source.line(row)
            if left <= source.lengths[row] or row == rows[-1]:
                return point_at(line, left)
            left -= float(source.lengths[row])
        raise AssertionError("a leg has edges")


def find_legs(source: SourceNetwork, ring: list[int], cut_m: float, *, inwards: bool) -> list[Leg]:
    """Entries (or exits) in ring order, each followed outwards to the cut or the next real junction."""
    members = set(ring)
    nodes = [int(source.tail[row]) for row in ring]
    legs = []
    for node in nodes:
        at_node = source.in_edges[node] if inwards else source.out_edges[node]
        for row in sorted(at_node):
            if row not in members and source.tail[row] != source.head[row]:
                chain = _follow(source, row, set(nodes), cut_m, inwards=inwards)
                kept = min(float(source.lengths[chain].sum()), cut_m)
                legs.append(Leg(node, tuple(chain[::-1] if inwards else chain), kept, inwards))
    return legs


def _follow(source: SourceNetwork, row: int, ring_nodes: set[int], cut_m: float, *, inwards: bool) -> list[int]:
    """The edges from the ring outwards: on through a node where one road goes on besides the ring's legs."""
    chain, total = [row], float(source.lengths[row])
    # A crumb of an edge at the cut is no part of the arm.
    while total < cut_m - _SLIVER_M:
        last = chain[-1]
        node = int(source.tail[last] if inwards else source.head[last])
        if node in ring_nodes:
            break
        beyond = {
            int(end)
            for edges, ends in ((source.in_edges[node], source.tail), (source.out_edges[node], source.head))
            for end in (ends[edge] for edge in edges)
        } - ring_nodes
        beyond -= {int(end) for edge in chain for end in (source.tail[edge], source.head[edge])}
        onward = source.in_edges[node] if inwards else source.out_edges[node]
        ends = source.tail if inwards else source.head
        candidates = [edge for edge in onward if int(ends[edge]) in beyond]
        if len(beyond) != 1 or len(candidates) != 1:
            break
        chain.append(candidates[0])
        total += float(source.lengths[candidates[0]])
    return chain


def same_arm(source: SourceNetwork, one: Leg, other: Leg) -> bool:
    """Do two legs lead to the same road? Their outer ends lie together."""
    return float(np.hypot(*(one.outer_end(source) - other.outer_end(source)))) < SAME_ARM_M


def leg_pieces(source: SourceNetwork, ring: list[int], legs: list[Leg]) -> list[EdgePiece]:
    """The ring whole, and of each leg what is kept."""
    spans = {row: (0.0, float("inf")) for row in ring}
    for leg in legs:
        left = leg.length
        for row in leg.rows[::-1] if leg.inwards else leg.rows:
            total = float(source.lengths[row])
            whole = left > total - _SLIVER_M
            start = total - left if leg.inwards and not whole else 0.0
            span = (start, float("inf") if leg.inwards or whole else left)
            spans[row] = span if row not in spans else _union(spans[row], span)
            left -= total
    return [EdgePiece(row, *span) for row, span in sorted(spans.items())]


def _union(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    return min(one[0], other[0]), max(one[1], other[1])
