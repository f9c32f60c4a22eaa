"""Roundabouts: a ring with all its arms, arms cut at 80 m; one map per ring, entry and exit.

Legs are the edges between the ring and the cut, entries and exits apart; two legs may be of one arm.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsbench.geometry.elementary import wrap_deg
from tsbench.make.city import extract_info
from tsbench.make.maps.pieces import EdgePiece, make_row, point_at
from tsbench.make.maps.source import SourceNetwork
from tsbench.make.maps.utm import Floats
from tsbench.scenarios.map_pool import PoolRow

# (entry, the other legs): cut at 80 m, or shorter where the carriageways of two arms run over each other further
# out; in the order of preference, the harvest keeps the first that is sound.
ARM_CUTS_M = ((80.0, 80.0), (80.0, 60.0), (80.0, 45.0), (60.0, 60.0), (60.0, 45.0), (45.0, 45.0))
LEG_MIN_M = 30.0
ENTRIES_MIN = 3
RING_MIN_M = 30.0
RING_MAX_M = 700.0
# A block of one-way streets has right-angled corners; a narrow one is no circle (1: circle, 0.785: square).
CORNER_MAX_DEG = 70.0
ROUNDNESS_MIN = 0.7
# In a generalised extract a ring is a polygon of few corners (rings that a better extract has: up to 78 degrees);
# it passes with more corners than a block has, all of them blunt, and rounder than a square.
COARSE_CORNERS_MIN = 5
COARSE_CORNER_MAX_DEG = 88.0
COARSE_ROUNDNESS_MIN = 0.8
# Outer ends this near to each other belong to one road: carriageways of a dual one lie 10-25 m apart.
SAME_ARM_M = 30.0
_SLIVER_M = 1.0


@dataclass(frozen=True, slots=True)
class _Ring:
    """A ring's edge rows in driving order, and what is cut of its legs for one entry."""

    rows: list[int]
    entry_cut_m: float
    arm_cut_m: float
    entries: list[Leg]
    exits: list[Leg]


def find_roundabouts(source: SourceNetwork, rejected: Counter[str]) -> Iterator[PoolRow]:
    """All roundabout maps, each with its arms cut in several ways, the preferred one first."""
    for edge_ids in source.rings:
        ring = _ordered(source, [source.edge_row[edge] for edge in edge_ids])
        if ring is None:
            rejected["roundabout: not one closed ring"] += 1
            continue
        fault = shape_fault(
            np.vstack([source.line(row)[:-1] for row in ring]),
            coarse=not extract_info(source.data, source.name).well_tagged,
        )
        fault = fault or _leg_fault(source, ring)
        if fault:
            rejected[f"roundabout: {fault}"] += 1
            continue
        for k, entry in enumerate(find_legs(source, ring, ARM_CUTS_M[0][0], inwards=True)):
            if entry.length < LEG_MIN_M:
                rejected["roundabout: entry is shorter than 30 m"] += 1
                continue
            yield from _maps_of_entry(source, ring, k)


def _maps_of_entry(source: SourceNetwork, ring: list[int], entry: int) -> Iterator[PoolRow]:
    for entry_cut_m, arm_cut_m in ARM_CUTS_M:
        cut = _cut(source, ring, entry, entry_cut_m, arm_cut_m)
        ranked = sorted(_other_exits(source, ring, entry), key=lambda k: _hash(source, cut, entry, k))
        for rank, leave in enumerate(ranked):
            yield _row(source, cut, entry, leave, rank)


def roundabout_pieces(source: SourceNetwork, detail: dict[str, Any]) -> list[EdgePiece]:
    """The pieces of a roundabout crop: ring and legs; the entry may be cut further out than the rest."""
    rows = [source.edge_row[edge] for edge in detail["ring"]]
    ring = _cut(source, rows, detail["entry"], detail["entry_cut_m"], detail["arm_cut_m"])
    return leg_pieces(source, ring.rows, ring.entries + ring.exits)


def roundabout_chains(detail: dict[str, Any]) -> list[tuple[list[str], str]]:
    """Of each leg the edges in driving order, and the one at the ring: that is what becomes of them in the crop."""
    ways = [(leg["edges"], leg["edges"][-1]) for leg in detail["entries"]]
    return ways + [(leg["edges"], leg["edges"][0]) for leg in detail["exits"]]


def _cut(source: SourceNetwork, ring: list[int], entry: int, entry_cut_m: float, arm_cut_m: float) -> _Ring:
    entries = find_legs(source, ring, arm_cut_m, inwards=True)
    entries[entry] = find_legs(source, ring, entry_cut_m, inwards=True)[entry]
    return _Ring(ring, entry_cut_m, arm_cut_m, entries, find_legs(source, ring, arm_cut_m, inwards=False))


def _other_exits(source: SourceNetwork, ring: list[int], entry: int) -> list[int]:
    """Exits of other arms than the entry's own, long enough to end a way on, by number."""
    whole = ARM_CUTS_M[0][1]
    own = find_legs(source, ring, whole, inwards=True)[entry]
    exits = find_legs(source, ring, whole, inwards=False)
    return [k for k, leg in enumerate(exits) if leg.length >= LEG_MIN_M and not same_arm(source, own, leg)]


def _hash(source: SourceNetwork, ring: _Ring, entry: int, leave: int) -> str:
    names = (source.edge_ids[ring.entries[entry].rows[-1]], source.edge_ids[ring.exits[leave].rows[0]])
    return hashlib.blake2b("\n".join(names).encode(), digest_size=8).hexdigest()


def _leg_fault(source: SourceNetwork, ring: list[int]) -> str:
    entries = find_legs(source, ring, ARM_CUTS_M[0][0], inwards=True)
    exits = find_legs(source, ring, ARM_CUTS_M[0][1], inwards=False)
    if len(exits) < 2:
        return "fewer than two exits"
    return "fewer than three entries" if len(entries) < ENTRIES_MIN else ""


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


def shape_fault(outline: Floats, *, coarse: bool) -> str:
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
    corner = max(abs(wrap_deg(float(turn))) for turn in np.diff(headings, append=headings[0]))
    roundness = 4 * np.pi * area / around**2
    blunt = (
        coarse
        and len(outline) >= COARSE_CORNERS_MIN
        and corner <= COARSE_CORNER_MAX_DEG
        and roundness >= COARSE_ROUNDNESS_MIN
    )
    if not blunt and (corner > CORNER_MAX_DEG or roundness < ROUNDNESS_MIN):
        return "a block of one-way streets, not round"
    return ""


def _row(source: SourceNetwork, ring: _Ring, entry: int, leave: int, rank: int) -> PoolRow:
    ids = source.edge_ids

    def leg_detail(leg: Leg) -> dict[str, object]:
        at_ring = leg.rows[-1] if leg.inwards else leg.rows[0]
        return {
            "node": source.node_ids[leg.at],
            "edges": [ids[row] for row in leg.rows],
            "length_m": round(leg.length, 1),
            "lanes": int(source.lanes[at_ring]),
        }

    arms = [
        (ids[one.rows[-1]], ids[other.rows[0]])
        for one in ring.entries
        for other in ring.exits
        if same_arm(source, one, other)
    ]
    entry_edge, exit_edge = ids[ring.entries[entry].rows[-1]], ids[ring.exits[leave].rows[0]]
    return make_row(
        source,
        family="roundabout",
        shape="ring",
        ids=[*sorted(ids[row] for row in ring.rows), "entry", entry_edge, "exit", exit_edge],
        pieces=leg_pieces(source, ring.rows, ring.entries + ring.exits),
        main=ring.rows,
        junctions={int(source.tail[row]) for row in ring.rows},
        curvature=0.0,
        length_m=float(source.lengths[ring.rows].sum()),
        detail={
            "ring": [ids[row] for row in ring.rows],
            "entry_cut_m": ring.entry_cut_m,
            "arm_cut_m": ring.arm_cut_m,
            "entries": [leg_detail(leg) for leg in ring.entries],
            "exits": [leg_detail(leg) for leg in ring.exits],
            "arms": arms,
            "entry": entry,
            "entry_edge": entry_edge,
            "exit": leave,
            "exit_edge": exit_edge,
            "rank": rank,
        },
    )


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
