"""Corridors: 150-250 m of one road between junctions, straight or gently curved."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np

from tsbench.geometry.elementary import wrap_deg
from tsbench.make.maps.pieces import EdgePiece, chord_over_arc, cut, length, make_row
from tsbench.make.maps.source import SourceNetwork
from tsbench.make.maps.utm import Floats
from tsbench.scenarios.map_pool import PoolRow

MIN_M = 150.0
MAX_M = 250.0
STRAIGHT = 0.99
CURVED = 0.97
WINDOW_STEP_M = 25.0
MAX_KINK_DEG = 30.0


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
        yield _row(source, row, span)


def corridor_pieces(source: SourceNetwork, detail: dict[str, Any]) -> list[EdgePiece]:
    """The pieces of a corridor crop: the edge's span and the same of its opposite."""
    start, end = detail["span"]
    return _pieces(source, source.edge_row[detail["edge"]], (start, end))


def _pieces(source: SourceNetwork, row: int, span: tuple[float, float]) -> list[EdgePiece]:
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


def _row(source: SourceNetwork, row: int, span: tuple[float, float]) -> PoolRow:
    line = cut(source.line(row), *span)
    ratio = round(chord_over_arc(line), 4)
    opposite = int(source.opposite[row])
    edge_id = source.edge_ids[row]
    return make_row(
        source,
        family="corridor",
        shape="straight" if ratio >= STRAIGHT else "curved",
        ids=[edge_id],
        pieces=_pieces(source, row, span),
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
