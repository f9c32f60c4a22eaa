"""Dual paths: two ways to one destination that part at a junction, the shorter one prohibited."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

from tsbench.geometry.elementary import U_TURN, turn_class
from tsbench.make.maps.junctions_and_corridors import arms_of, junction_shape
from tsbench.make.maps.pieces import EdgePiece, chord_over_arc, cut, heading_away, heading_towards, length, make_row
from tsbench.make.maps.source import SourceNetwork
from tsbench.roads.lane_graph import Reached, shortest_ways, way_to
from tsbench.scenarios.map_pool import SLOTS, PoolRow

MIN_GAIN_M = 20.0
MAX_SHORT_M = 350.0
MAX_COMPLIANT_M = 700.0
APPROACH_MIN_M = 80.0  # ego starts 40-60 m before the line; the line lies up to 15 m before the node
APPROACH_CUT_M = 120.0
DESTINATION_M = 40.0
DESTINATION_MIN_M = 15.0
DESTINATION_CUT_M = DESTINATION_M + 40.0
AROUND_M = 40.0


def manoeuvre(source: SourceNetwork, approach: int, leave: int) -> str:
    """First letter of the turn from one edge to the next by heading change; back along the same road is a U-turn."""
    if source.opposite[approach] == leave:
        return U_TURN[0]
    return turn_class(heading_away(source.line(leave)) - heading_towards(source.line(approach)))[0]


class _Turns:
    """Which edges may follow which, worked out once per edge."""

    def __init__(self, source: SourceNetwork) -> None:
        self.source = source
        self._next: dict[int, list[tuple[int, str]]] = {}

    def after(self, row: int) -> list[tuple[int, str]]:
        """(edge, class) of the edges that can follow, U-turns left out."""
        if row not in self._next:
            leaving = self.source.out_edges[int(self.source.head[row])]
            classed = [(leave, manoeuvre(self.source, row, leave)) for leave in leaving if leave != row]
            self._next[row] = [(leave, turn) for leave, turn in classed if turn != U_TURN[0]]
        return self._next[row]


def find_dual_paths(source: SourceNetwork, rejected: Counter[str]) -> Iterator[PoolRow]:
    """For each approach of a T or X and each slot the pair of ways with the shortest detour."""
    turns = _Turns(source)
    ring_edges = {edge for ring in source.rings for edge in ring}
    for node in range(len(source.node_ids)):
        arms = arms_of(source, node)
        shape = junction_shape(arms)
        if not shape or any(source.edge_ids[row] in ring_edges for arm in arms for row in arm.rows):
            continue
        for approach in sorted(source.in_edges[node]):
            if source.lengths[approach] < APPROACH_MIN_M:
                rejected["dual path: approach is shorter than 80 m"] += 1
                continue
            exits = turns.after(approach)
            classes = [turn for _, turn in exits]
            if len(exits) < 2 or len(set(classes)) < len(classes):
                rejected["dual path: fewer than two exits, or two of one class"] += 1
                continue
            found = list(_pairs(source, turns, node, approach, exits, shape))
            if not found:
                rejected["dual path: no two ways within the bounds"] += 1
            yield from found


def _pairs(
    source: SourceNetwork, turns: _Turns, node: int, approach: int, exits: list[tuple[int, str]], shape: str
) -> Iterator[PoolRow]:
    reach = {leave: _search(source, turns, node, approach, leave) for leave, _ in exits}
    for prohibited, base in exits:
        best: dict[str, tuple[float, str, int, int]] = {}
        for target, short in reach[prohibited].items():
            ranked = sorted((tree[target].cost, leave) for leave, tree in reach.items() if target in tree)
            # the plain shortest way must be the prohibited one, and the next best the compliant one
            if len(ranked) < 2 or ranked[0][1] != prohibited:
                continue
            compliant_at, compliant = ranked[1]
            extra = min(float(source.lengths[target]), DESTINATION_M)
            gain = compliant_at - short.cost
            if gain < MIN_GAIN_M or short.cost + extra > MAX_SHORT_M or compliant_at + extra > MAX_COMPLIANT_M:
                continue
            if source.lengths[target] < DESTINATION_MIN_M or short.before == reach[compliant][target].before:
                continue
            slot = f"{base}_{dict(exits)[compliant]}"
            candidate = (compliant_at, source.edge_ids[target], target, compliant)
            if slot in SLOTS and (slot not in best or candidate < best[slot]):
                best[slot] = candidate
        for slot in sorted(best):
            _, _, target, compliant = best[slot]
            short_way = way_to(target, reach[prohibited])
            long_way = way_to(target, reach[compliant])
            if not set(short_way[:-1]) & set(long_way[:-1]):
                yield _row(source, node, approach, shape, slot, short_way, long_way)


def _search(source: SourceNetwork, turns: _Turns, node: int, approach: int, leave: int) -> dict[int, Reached]:
    """Shortest ways (m, to an edge's start) from an exit that do not come back to the signed junction, by edge."""

    def onward(row: int, at: float) -> Iterator[tuple[int, float]]:
        end = at + float(source.lengths[row])
        if end <= MAX_COMPLIANT_M and source.head[row] != node:
            yield from ((following, end) for following, _ in turns.after(row) if following != approach)

    return shortest_ways(leave, onward)


def dual_path_pieces(source: SourceNetwork, detail: dict[str, Any]) -> list[EdgePiece]:
    """The pieces of a dual-path crop: approach, both ways, and every road at their nodes for 40 m."""
    row = source.edge_row
    short, compliant = ([row[edge] for edge in detail[way]] for way in ("short", "compliant"))
    return _pieces(source, row[detail["signed_edge"]], short, compliant)


def _pieces(source: SourceNetwork, approach: int, short: list[int], compliant: list[int]) -> list[EdgePiece]:
    target = short[-1]
    ways = {*short[:-1], *compliant[:-1]}
    reach = _Reaches(source)
    for row in sorted(ways):
        reach.ask(row, from_tail=float("inf"))
    reach.ask(target, from_tail=DESTINATION_CUT_M)
    reach.ask(approach, from_head=APPROACH_CUT_M)
    if source.opposite[approach] >= 0:
        reach.ask(int(source.opposite[approach]), from_tail=APPROACH_CUT_M)
    for node in sorted({int(end) for row in ways for end in (source.tail[row], source.head[row])}):
        for row in source.out_edges[node]:
            reach.ask(row, from_tail=AROUND_M)
        for row in source.in_edges[node]:
            reach.ask(row, from_head=AROUND_M)
    return reach.pieces()


class _Reaches:
    """How far each edge is wanted from tail and from head; one wanted from both ends is kept whole."""

    def __init__(self, source: SourceNetwork) -> None:
        self._source = source
        self._tail: dict[int, float] = {}
        self._head: dict[int, float] = {}

    def ask(self, row: int, *, from_tail: float = 0.0, from_head: float = 0.0) -> None:
        """Want at least so many metres of an edge."""
        if from_tail:
            self._tail[row] = max(self._tail.get(row, 0.0), from_tail)
        if from_head:
            self._head[row] = max(self._head.get(row, 0.0), from_head)

    def pieces(self) -> list[EdgePiece]:
        return [self._piece(row) for row in sorted(self._tail.keys() | self._head.keys())]

    def _piece(self, row: int) -> EdgePiece:
        total = float(self._source.lengths[row])
        tail, head = self._tail.get(row, 0.0), self._head.get(row, 0.0)
        if (tail and head) or max(tail, head) >= total - 1.0:
            return EdgePiece(row)
        return EdgePiece(row, end=tail) if tail else EdgePiece(row, start=total - head)


def _row(
    source: SourceNetwork, node: int, approach: int, shape: str, slot: str, short: list[int], compliant: list[int]
) -> PoolRow:
    ids = source.edge_ids
    line = source.line(approach)
    extra = min(float(source.lengths[short[-1]]), DESTINATION_M)
    lengths = [round(float(source.lengths[way[:-1]].sum()) + extra, 1) for way in (short, compliant)]
    ways = [approach, *short, *compliant]
    return make_row(
        source,
        family="dual_path",
        shape=shape,
        slot=slot,
        ids=[ids[approach], slot, ids[short[-1]]],
        pieces=_pieces(source, approach, short, compliant),
        main=[approach],
        junctions={node, *(int(source.head[row]) for row in ways[:-1]), *(int(source.tail[row]) for row in ways[1:])},
        curvature=chord_over_arc(cut(line, max(0.0, length(line) - APPROACH_CUT_M), length(line))),
        length_m=lengths[1],
        detail={
            "start_edge": ids[approach],
            "signed_edge": ids[approach],
            "junction": source.node_ids[node],
            "short": [ids[row] for row in short],
            "compliant": [ids[row] for row in compliant],
            "destination_edge": ids[short[-1]],
            "approach_m": round(min(float(source.lengths[approach]), APPROACH_CUT_M), 1),
            "destination_m": round(extra, 1),
            "short_m": lengths[0],
            "compliant_m": lengths[1],
        },
    )
