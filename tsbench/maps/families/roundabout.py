"""Roundabouts: a ring with all its arms, arms cut at 80 m; one map per ring and entry arm."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tsbench.maps.cut import Piece
from tsbench.maps.families.common import make_row
from tsbench.maps.lines import wrap
from tsbench.maps.pool import PoolRow
from tsbench.maps.source import SourceNetwork
from tsbench.maps.utm import Floats

# Arms are cut at 80 m, or shorter where the carriageways of two arms run over each other further out.
ARM_CUTS_M = (80.0, 60.0, 45.0)
ENTRY_MIN_M = 30.0
RING_MIN_M = 30.0
RING_MAX_M = 700.0
# A block of one-way streets has right-angled corners; a narrow one is no circle (1: circle, 0.785: square).
CORNER_MAX_DEG = 70.0
ROUNDNESS_MIN = 0.7


@dataclass(frozen=True, slots=True)
class _Leg:
    """Edges between the ring and the cut, in driving order; `at` the ring node, `length` what is kept."""

    at: int
    rows: tuple[int, ...]
    length: float


def find_roundabouts(source: SourceNetwork, rejected: Counter[str]) -> Iterator[PoolRow]:
    """All roundabout maps, each with its arms cut at 80, 60 and 45 m: the harvest keeps the longest sound."""
    for edge_ids in source.rings:
        rows = [source.edge_row[edge] for edge in edge_ids]
        ring = _ordered(source, rows)
        if ring is None:
            rejected["roundabout: not one closed ring"] += 1
            continue
        fault = _shape_fault(np.vstack([source.line(row)[:-1] for row in ring]))
        if fault:
            rejected[f"roundabout: {fault}"] += 1
            continue
        for cut_m in ARM_CUTS_M:
            entries = _legs(source, ring, cut_m, inwards=True)
            exits = _legs(source, ring, cut_m, inwards=False)
            if len(exits) < 2:
                rejected["roundabout: fewer than two exits"] += 1
                break
            for entry in entries:
                if entry.length >= ENTRY_MIN_M:
                    yield _row(source, ring, entries, exits, entry, cut_m)
                elif cut_m == ARM_CUTS_M[0]:
                    rejected["roundabout: entry is shorter than 30 m"] += 1


def roundabout_pieces(source: SourceNetwork, detail: dict[str, object]) -> list[Piece]:
    """The pieces of a roundabout crop: they depend on the ring only."""
    edges = detail["ring"]
    assert isinstance(edges, list)
    ring = [source.edge_row[edge] for edge in edges]
    cut_m = float(str(detail["arm_cut_m"]))
    legs = _legs(source, ring, cut_m, inwards=True) + _legs(source, ring, cut_m, inwards=False)
    return _pieces(source, ring, legs, cut_m)


def _ordered(source: SourceNetwork, rows: list[int]) -> list[int] | None:
    """Ring edges in driving order from the smallest id on, or None if they make no single cycle."""
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


def _shape_fault(outline: Floats) -> str:
    """Why a closed line, (n, 2) without its first point again, is no ring of a roundabout, or ""."""
    steps = np.roll(outline, -1, axis=0) - outline
    around = float(np.hypot(*steps.T).sum())
    if not RING_MIN_M <= around <= RING_MAX_M:
        return f"circumference outside {RING_MIN_M:.0f}-{RING_MAX_M:.0f} m"
    x, y = (outline - outline.mean(axis=0)).T
    area = float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) / 2)
    if area <= 0:
        return "driven clockwise"
    headings = np.degrees(np.arctan2(steps[:, 1], steps[:, 0]))
    corners = [abs(wrap(float(turn))) for turn in np.diff(headings, append=headings[0])]
    if max(corners) > CORNER_MAX_DEG or 4 * np.pi * area / around**2 < ROUNDNESS_MIN:
        return "a block of one-way streets, not round"
    return ""


def _legs(source: SourceNetwork, ring: list[int], cut_m: float, *, inwards: bool) -> list[_Leg]:
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
                legs.append(_Leg(node, tuple(chain[::-1] if inwards else chain), kept))
    return legs


def _follow(
    source: SourceNetwork, row: int, ring_nodes: set[int], cut_m: float, *, inwards: bool
) -> list[int]:
    """The edges from the ring outwards: on through a node where one road goes on besides the ring's legs."""
    chain, total = [row], float(source.lengths[row])
    while total < cut_m:
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


def _pieces(source: SourceNetwork, ring: list[int], legs: list[_Leg], cut_m: float) -> list[Piece]:
    spans = {row: (0.0, float("inf")) for row in ring}
    for leg in legs:
        inwards = source.head[leg.rows[-1]] == leg.at
        left = cut_m
        for row in leg.rows[::-1] if inwards else leg.rows:
            total = float(source.lengths[row])
            if left <= 1.0:
                break
            span = (
                (max(0.0, total - left), float("inf"))
                if inwards
                else (0.0, left if left < total else float("inf"))
            )
            spans[row] = span if row not in spans else _union(spans[row], span)
            left -= total
    return [Piece(row, *span) for row, span in sorted(spans.items())]


def _union(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    return min(one[0], other[0]), max(one[1], other[1])


def _row(
    source: SourceNetwork, ring: list[int], entries: list[_Leg], exits: list[_Leg], entry: _Leg, cut_m: float
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
        pieces=_pieces(source, ring, entries + exits, cut_m),
        main=ring,
        junctions={int(source.tail[row]) for row in ring},
        curvature=0.0,
        length_m=float(source.lengths[ring].sum()),
        detail={
            "ring": [ids[row] for row in ring],
            "arm_cut_m": cut_m,
            "entries": [leg_detail(leg) for leg in entries],
            "exits": [leg_detail(leg) for leg in exits],
            "entry": entries.index(entry),
            "entry_edge": ids[entry.rows[-1]],
        },
    )
