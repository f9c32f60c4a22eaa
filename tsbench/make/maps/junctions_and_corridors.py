"""Maps of one junction, and of one road between junctions.

Junctions: three (T) or four (X) arms without signals, each at least 40 m long and cut at 80 m. Arms are roads, not
edges: a pair of opposite edges, or a one-way edge. Corridors: 150-250 m of one road, straight or gently curved.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from tsbench.geometry.elementary import STRAIGHT_DEG, wrap_deg
from tsbench.make.maps.pieces import EdgePiece, arm_pieces, chord_over_arc, cut, heading_away, length, make_row
from tsbench.make.maps.source import SourceNetwork
from tsbench.make.maps.utm import Floats
from tsbench.scenarios.map_pool import PoolRow

ARM_MIN_M = 40.0
ARM_CUT_M = 80.0
ARM_HEADING_SPAN_M = 25.0
SEPARATION_DEG = 40.0
SIGNAL_RADIUS_M = 30.0
SHAPES = {3: "T", 4: "X"}


MIN_M = 150.0
MAX_M = 250.0
STRAIGHT = 0.99
CURVED = 0.97
WINDOW_STEP_M = 25.0
MAX_KINK_DEG = 30.0


def near_signal(source: SourceNetwork) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Which nodes have an OSM signal within 30 m, (n,): mappers put signals on the stop lines, too."""
    if not len(source.signals):
        return np.zeros(len(source.node_ids), bool)
    distance, _ = cKDTree(source.signals).query(source.node_xy)
    result: np.ndarray[tuple[int], np.dtype[np.bool_]] = distance < SIGNAL_RADIUS_M
    return result


def junction_shape(arms: list[Arm]) -> str:
    """`T`, `X`, or "" for what is neither: merges, forks, slip roads, split carriageways, stars.

    Arms are at least 40 degrees apart; a T has one pair of arms that go straight on, an X two.
    """
    shape = SHAPES.get(len(arms), "")
    if not shape or least_separation(arms) < SEPARATION_DEG:
        return ""
    return shape if len(through_pairs(arms)) == len(arms) - 2 else ""


def find_junctions(source: SourceNetwork, rejected: Counter[str]) -> Iterator[PoolRow]:
    """All junction maps of a source; `rejected` counts, by reason, nodes of 3 or 4 arms that are none."""
    signals = near_signal(source)
    ring_edges = {edge for ring in source.rings for edge in ring}
    for node in range(len(source.node_ids)):
        arms = arms_of(source, node)
        if len(arms) not in SHAPES:
            continue
        if any(source.edge_ids[row] in ring_edges for arm in arms for row in arm.rows):
            reason = "on a roundabout"
        elif signals[node]:
            reason = "has signals"
        elif min(arm.length_m for arm in arms) < ARM_MIN_M:
            reason = "an arm is shorter than 40 m"
        elif not junction_shape(arms):
            reason = "neither T nor X (merge, fork, split carriageway, star)"
        elif min(sum(a.in_row is not None for a in arms), sum(a.out_row is not None for a in arms)) < 2:
            reason = "fewer than two ways in or out"
        else:
            yield _row(source, node, arms)
            continue
        rejected[f"junction: {reason}"] += 1


def junction_pieces(source: SourceNetwork, detail: dict[str, Any]) -> list[EdgePiece]:
    def row(edge: str | None) -> int | None:
        return None if edge is None else source.edge_row[edge]

    arms = [(row(arm["in_edge"]), row(arm["out_edge"])) for arm in detail["arms"]]
    return [piece for arm in arms for piece in arm_pieces(source, *arm, ARM_CUT_M)]


def arm_detail(source: SourceNetwork, arm: Arm) -> dict[str, object]:
    """An arm as data: edges, heading outwards in degrees, kept length in metres, lanes in and out, class."""
    any_row = arm.rows[0]
    return {
        "in_edge": source.edge_ids[arm.in_row] if arm.in_row is not None else None,
        "out_edge": source.edge_ids[arm.out_row] if arm.out_row is not None else None,
        "heading_deg": round(arm.heading_deg, 1),
        "length_m": round(min(arm.length_m, ARM_CUT_M), 1),
        "lanes_in": int(source.lanes[arm.in_row]) if arm.in_row is not None else 0,
        "lanes_out": int(source.lanes[arm.out_row]) if arm.out_row is not None else 0,
        "class": source.road_class[any_row],
    }


def _row(source: SourceNetwork, node: int, arms: list[Arm]) -> PoolRow:
    pairs = through_pairs(arms)
    bends = [abs(arms[i].heading_deg - arms[j].heading_deg) for i, j in pairs]
    straightness = max(float(np.sin(np.radians(bend / 2))) for bend in bends)
    return make_row(
        source,
        family="junction",
        shape=junction_shape(arms),
        ids=[source.node_ids[node]],
        pieces=[p for arm in arms for p in arm_pieces(source, arm.in_row, arm.out_row, ARM_CUT_M)],
        main=[row for arm in arms for row in arm.rows],
        junctions=[node],
        curvature=straightness,
        length_m=min(min(arm.length_m, ARM_CUT_M) for arm in arms),
        detail={
            "node": source.node_ids[node],
            "arms": [arm_detail(source, arm) for arm in arms],
            "through": [list(pair) for pair in pairs],
        },
    )


@dataclass(frozen=True, slots=True)
class Arm:
    """One road at a node: the rows of its edges in and out (None: one-way); the heading points outwards."""

    in_row: int | None
    out_row: int | None
    heading_deg: float
    length_m: float

    @property
    def rows(self) -> tuple[int, ...]:
        """The rows that exist, incoming first."""
        return tuple(row for row in (self.in_row, self.out_row) if row is not None)


def arms_of(source: SourceNetwork, node: int) -> list[Arm]:
    """All arms of a node, counter-clockwise from east. Loops at the node are left out."""
    arms = []
    used: set[int] = set()
    for out in source.out_edges[node]:
        if source.head[out] == node:
            continue
        back = int(source.opposite[out])
        if back >= 0:
            used.add(back)
        arms.append(_arm(source, back if back >= 0 else None, out))
    for inward in source.in_edges[node]:
        if inward not in used and source.tail[inward] != node:
            arms.append(_arm(source, inward, None))
    return sorted(arms, key=lambda arm: (arm.heading_deg % 360.0, arm.rows))


def _arm(source: SourceNetwork, in_row: int | None, out_row: int | None) -> Arm:
    if out_row is not None:
        line, length_m = source.line(out_row), float(source.lengths[out_row])
    else:
        assert in_row is not None  # an arm has at least one edge
        line, length_m = source.line(in_row)[::-1], float(source.lengths[in_row])
    return Arm(in_row, out_row, heading_away(line, ARM_HEADING_SPAN_M), length_m)


def least_separation(arms: list[Arm]) -> float:
    """The smallest angle between two arms, degrees."""
    return min(abs(wrap_deg(a.heading_deg - b.heading_deg)) for a, b in combinations(arms, 2))


def through_pairs(arms: list[Arm]) -> list[tuple[int, int]]:
    """Pairs of arms that go straight on (within 35 degrees), each arm in its best pair only."""
    bends = sorted(
        (180.0 - abs(wrap_deg(arms[i].heading_deg - arms[j].heading_deg)), i, j)
        for i, j in combinations(range(len(arms)), 2)
    )
    pairs: list[tuple[int, int]] = []
    for bend, i, j in bends:
        if bend <= STRAIGHT_DEG and not any({i, j} & set(pair) for pair in pairs):
            pairs.append((i, j))
    return sorted(pairs)


def find_corridors(source: SourceNetwork, rejected: Counter[str]) -> Iterator[PoolRow]:
    """At most one corridor per OSM way, the widest and longest edges first."""
    ring_edges = {edge for ring in source.rings for edge in ring}
    used: set[int] = set()
    order = sorted(
        range(len(source.edge_ids)),
        key=lambda row: (-int(source.lanes[row]), -min(float(source.lengths[row]), MAX_M), source.edge_ids[row]),
    )
    for row in order:
        if source.lengths[row] < MIN_M or source.tail[row] == source.head[row]:
            continue
        opposite = int(source.opposite[row])
        ways = set(source.osm_ids[row]) | (set(source.osm_ids[opposite]) if opposite >= 0 else set())
        if source.edge_ids[row] in ring_edges:
            rejected["corridor: on a roundabout"] += 1
            continue
        if ways & used:
            rejected["corridor: its OSM way has one already"] += 1
            continue
        span = _best_span(source.line(row))
        if span is None:
            rejected["corridor: no window of 150 m is straight enough"] += 1
            continue
        used |= ways
        yield _corridor_row(source, row, span)


def corridor_pieces(source: SourceNetwork, detail: dict[str, Any]) -> list[EdgePiece]:
    """The pieces of a corridor crop: the edge's span and the same of its opposite."""
    start, end = detail["span"]
    return _span_pieces(source, source.edge_row[detail["edge"]], (start, end))


def _span_pieces(source: SourceNetwork, row: int, span: tuple[float, float]) -> list[EdgePiece]:
    start, end = span
    pieces = [EdgePiece(row, start, end)]
    opposite = int(source.opposite[row])
    if opposite >= 0:
        total = float(source.lengths[opposite])
        pieces.append(EdgePiece(opposite, max(0.0, total - end), total - start))
    return pieces


def _best_span(line: Floats) -> tuple[float, float] | None:
    """The window nearest to the middle that is straight enough: 250 m (or the whole edge), else 150 m."""
    total = length(line)
    for size in (min(total, MAX_M), MIN_M):
        middle = (total - size) / 2
        starts = {0.0, middle, total - size, *np.arange(0.0, total - size, WINDOW_STEP_M).tolist()}
        for start in sorted(starts, key=lambda at: (abs(at - middle), at)):
            part = cut(line, start, start + size)
            if chord_over_arc(part) >= CURVED and _kink(part) <= MAX_KINK_DEG:
                begin = np.floor(start * 10) / 10
                return round(float(begin), 1), round(float(begin) + size, 1)
    return None


def _kink(line: Floats) -> float:
    """The sharpest bend at a vertex, degrees."""
    headings = np.degrees(np.arctan2(*np.diff(line, axis=0).T[::-1]))
    return max((abs(wrap_deg(float(turn))) for turn in np.diff(headings)), default=0.0)


def _corridor_row(source: SourceNetwork, row: int, span: tuple[float, float]) -> PoolRow:
    line = cut(source.line(row), *span)
    ratio = round(chord_over_arc(line), 4)
    opposite = int(source.opposite[row])
    edge_id = source.edge_ids[row]
    return make_row(
        source,
        family="corridor",
        shape="straight" if ratio >= STRAIGHT else "curved",
        ids=[edge_id],
        pieces=_span_pieces(source, row, span),
        main=[row],
        junctions=[],
        curvature=ratio,
        length_m=span[1] - span[0],
        detail={
            "edge": edge_id,
            "span": list(span),
            "opposite": source.edge_ids[opposite] if opposite >= 0 else None,
            "ends": [source.node_ids[source.tail[row]], source.node_ids[source.head[row]]],
        },
    )
