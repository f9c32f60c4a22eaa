"""Roundabouts: a ring with all its arms, arms cut at 80 m; one map per ring and entry arm."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tsbench.maps.cut import Piece
from tsbench.maps.families.common import make_row
from tsbench.maps.pool import PoolRow
from tsbench.maps.source import SourceNetwork
from tsbench.maps.utm import Floats

ARM_CUT_M = 80.0
ENTRY_MIN_M = 30.0
RING_MAX_M = 700.0
RING_MIN_M = 30.0


@dataclass(frozen=True, slots=True)
class _Leg:
    """A chain of edges between the ring and the cut, in driving order; `at` the ring node, `length` what is kept."""

    at: int
    rows: tuple[int, ...]
    length: float


def find_roundabouts(source: SourceNetwork, rejected: Counter[str]) -> Iterator[PoolRow]:
    """All roundabout maps of a source."""
    for edge_ids in source.rings:
        rows = [source.edge_row[edge] for edge in edge_ids]
        ring = _ordered(source, rows)
        if ring is None:
            rejected["roundabout: not one closed ring"] += 1
            continue
        around = float(source.lengths[ring].sum())
        if not RING_MIN_M <= around <= RING_MAX_M or _signed_area(np.vstack([source.line(r) for r in ring])) <= 0:
            rejected["roundabout: circumference outside 30-700 m, or clockwise"] += 1
            continue
        entries = _legs(source, ring, inwards=True)
        exits = _legs(source, ring, inwards=False)
        if len(exits) < 2:
            rejected["roundabout: fewer than two exits"] += 1
            continue
        for entry in entries:
            if entry.length < ENTRY_MIN_M:
                rejected["roundabout: entry is shorter than 30 m"] += 1
                continue
            yield _row(source, ring, entries, exits, entry, around)


def roundabout_pieces(source: SourceNetwork, detail: dict[str, object]) -> list[Piece]:
    """The pieces of a roundabout crop: they depend on the ring only."""
    edges = detail["ring"]
    assert isinstance(edges, list)
    ring = [source.edge_row[edge] for edge in edges]
    return _pieces(source, ring, _legs(source, ring, inwards=True) + _legs(source, ring, inwards=False))


def _ordered(source: SourceNetwork, rows: list[int]) -> list[int] | None:
    """Ring edges in driving order from the smallest id on, or None if they make no single cycle of two or more."""
    after = {int(source.tail[row]): row for row in rows}
    if len(after) != len(rows) or len(rows) < 2:
        return None
    ring = [min(rows, key=lambda row: source.edge_ids[row])]
    while len(ring) < len(rows):
        following = after.get(int(source.head[ring[-1]]))
        if following is None or following in ring:
            return None
        ring.append(following)
    return ring if source.head[ring[-1]] == source.tail[ring[0]] else None


def _signed_area(line: Floats) -> float:
    """Positive for a counter-clockwise ring (right-hand traffic)."""
    x, y = (line - line.mean(axis=0)).T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) / 2)


def _legs(source: SourceNetwork, ring: list[int], *, inwards: bool) -> list[_Leg]:
    """Entries (or exits), in ring order, each followed outwards for 80 m or to the next junction that matters."""
    members = set(ring)
    nodes = [int(source.tail[row]) for row in ring]
    legs = []
    for node in nodes:
        at_node = source.in_edges[node] if inwards else source.out_edges[node]
        for row in sorted(at_node):
            if row not in members and source.tail[row] != source.head[row]:
                chain = _follow(source, row, set(nodes), inwards=inwards)
                kept = min(float(source.lengths[chain].sum()), ARM_CUT_M)
                legs.append(_Leg(node, tuple(chain[::-1] if inwards else chain), kept))
    return legs


def _follow(source: SourceNetwork, row: int, ring_nodes: set[int], *, inwards: bool) -> list[int]:
    """The chain of edges from the ring outwards: on through a node where only one road goes on besides the ring's legs."""
    chain, total = [row], float(source.lengths[row])
    while total < ARM_CUT_M:
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


def _pieces(source: SourceNetwork, ring: list[int], legs: list[_Leg]) -> list[Piece]:
    spans = {row: (0.0, float("inf")) for row in ring}
    for leg in legs:
        inwards = source.head[leg.rows[-1]] == leg.at
        left = ARM_CUT_M
        for row in leg.rows[::-1] if inwards else leg.rows:
            total = float(source.lengths[row])
            if left <= 1.0:
                break
            span = (max(0.0, total - left), float("inf")) if inwards else (0.0, left if left < total else float("inf"))
            spans[row] = span if row not in spans else _union(spans[row], span)
            left -= total
    return [Piece(row, *span) for row, span in sorted(spans.items())]


def _union(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    return min(one[0], other[0]), max(one[1], other[1])


def _row(
    source: SourceNetwork, ring: list[int], entries: list[_Leg], exits: list[_Leg], entry: _Leg, around: float
) -> PoolRow:
    ids = source.edge_ids

    def leg_detail(leg: _Leg) -> dict[str, object]:
        return {
            "node": source.node_ids[leg.at],
            "edges": [ids[row] for row in leg.rows],
            "length_m": round(leg.length, 1),
            "lanes": int(source.lanes[leg.rows[-1]]),
        }

    return make_row(
        source,
        family="roundabout",
        shape="ring",
        ids=[*sorted(ids[row] for row in ring), "entry", ids[entry.rows[-1]]],
        pieces=_pieces(source, ring, entries + exits),
        main=ring,
        junctions={int(source.tail[row]) for row in ring},
        curvature=0.0,
        length_m=around,
        detail={
            "ring": [ids[row] for row in ring],
            "entries": [leg_detail(leg) for leg in entries],
            "exits": [leg_detail(leg) for leg in exits],
            "entry": entries.index(entry),
            "entry_edge": ids[entry.rows[-1]],
        },
    )
