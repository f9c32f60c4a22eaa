"""Pieces of a source network: their lines, the pool's row about them, and the `PlainNet` that they make.

Lines are (n, 2) arrays in metres; angles are degrees, counter-clockwise from east.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsbench.geometry.elementary import wrap_deg
from tsbench.make.city import extract_info
from tsbench.make.maps.plain import PlainEdge, PlainNet, PlainNode
from tsbench.make.maps.source import SourceNetwork
from tsbench.make.maps.utm import Floats
from tsbench.scenarios.map_pool import PoolRow, map_id

SAME_END_M = 0.5
HEADING_SPAN_M = 15.0


@dataclass(frozen=True, slots=True)
class EdgePiece:
    """A part of an edge: its row and the span along its line in metres (0, inf = all of it)."""

    row: int
    start: float = 0.0
    end: float = float("inf")


def arm_pieces(source: SourceNetwork, in_row: int | None, out_row: int | None, reach: float) -> list[EdgePiece]:
    """Both edges of an arm up to `reach` metres from its node."""
    pieces = []
    if in_row is not None:
        pieces.append(EdgePiece(in_row, start=max(0.0, float(source.lengths[in_row]) - reach)))
    if out_row is not None:
        pieces.append(EdgePiece(out_row, end=min(float(source.lengths[out_row]), reach)))
    return pieces


def assemble(source: SourceNetwork, pieces: Sequence[EdgePiece], roundabouts: Sequence[Sequence[str]] = ()) -> PlainNet:
    """The pieces as one network, in metres around the crop's centre (a whole metre of the UTM grid)."""
    lines = {piece.row: _line(source, piece) for piece in sorted(pieces, key=lambda p: p.row)}
    everything = np.vstack(list(lines.values()))
    centre = np.round((everything.min(axis=0) + everything.max(axis=0)) / 2)
    nodes: dict[str, PlainNode] = {}
    ends: list[PlainNode] = []
    edges = []
    for piece in sorted(pieces, key=lambda p: p.row):
        line = lines[piece.row] - centre
        tail, head = int(source.tail[piece.row]), int(source.head[piece.row])
        begins, finishes = piece.start > 0.0, piece.end < float(source.lengths[piece.row])
        edge_id = source.edge_ids[piece.row]
        tail_id = _end_node(f"{edge_id}.start", line[0], ends, nodes) if begins else _node(source, tail, centre, nodes)
        head_id = _end_node(f"{edge_id}.end", line[-1], ends, nodes) if finishes else _node(source, head, centre, nodes)
        edges.append(_edge(source, piece.row, tail_id, head_id, line))
    lat, lon = source.frame.to_degrees(*centre).tolist()
    east = source.frame.true_east(centre[0])
    return PlainNet(
        nodes=tuple(sorted(nodes.values(), key=lambda node: node.id)),
        edges=tuple(edges),
        connections=(),
        roundabouts=tuple(tuple(ring) for ring in roundabouts),
        origin=(round(lat, 7), round(lon, 7)),
        attributes={"source": source.name, "utm_east": f"{east:.0f}", "utm_north": f"{centre[1]:.0f}"},
        data=source.data,
    )


def _line(source: SourceNetwork, piece: EdgePiece) -> Floats:
    line = source.line(piece.row)
    if piece.start <= 0.0 and piece.end >= source.lengths[piece.row]:
        return line
    return cut(line, piece.start, min(piece.end, float(source.lengths[piece.row])))


def _node(source: SourceNetwork, row: int, centre: Floats, nodes: dict[str, PlainNode]) -> str:
    name = source.node_ids[row]
    x, y = (source.node_xy[row] - centre).tolist()
    nodes[name] = PlainNode(name, round(x, 2), round(y, 2))
    return name


def _end_node(name: str, place: Floats, ends: list[PlainNode], nodes: dict[str, PlainNode]) -> str:
    """The dead end at a cut: one node for both directions of a road."""
    x, y = (round(float(value), 2) for value in place)
    for known in ends:
        if np.hypot(known.x - x, known.y - y) < SAME_END_M:
            return known.id
    nodes[name] = PlainNode(name, x, y)
    ends.append(nodes[name])
    return name


def _edge(source: SourceNetwork, row: int, tail: str, head: str, line: Floats) -> PlainEdge:
    return PlainEdge(
        id=source.edge_ids[row],
        source=tail,
        target=head,
        num_lanes=int(source.lanes[row]),
        speed=float(source.speed[row]),
        priority=int(source.priority[row]),
        shape=tuple((round(x, 2), round(y, 2)) for x, y in line.tolist()),
        type=f"highway.{source.road_class[row]}" if source.road_class[row] else "",
        name=source.street[row],
        width=float(source.width[row]),
        spread="center" if source.centred[row] else "right",
    )


def piece_line(source: SourceNetwork, piece: EdgePiece) -> Floats:
    return cut(source.line(piece.row), piece.start, min(piece.end, float(source.lengths[piece.row])))


def osm_nodes(node_id: str) -> list[str]:
    """The OSM nodes of a junction: a joined one is called `cluster_1_2_3`."""
    return node_id.removeprefix("cluster_").split("_") if node_id.startswith("cluster_") else [node_id]


def make_row(
    source: SourceNetwork,
    *,
    family: str,
    shape: str,
    ids: Sequence[str],
    pieces: Sequence[EdgePiece],
    main: Sequence[int],
    junctions: Iterable[int],
    curvature: float,
    length_m: float,
    detail: dict[str, Any],
    slot: str = "",
) -> PoolRow:
    """A row: `pieces` bound the crop, `main` edges give lanes, speed and class, `junctions` are node rows."""
    extract = extract_info(source.data, source.name)
    points = np.vstack([piece_line(source, piece) for piece in pieces])
    low, high = points.min(axis=0), points.max(axis=0)
    east, north = ((low + high) / 2).tolist()
    half_w, half_h = ((high - low) / 2).tolist()
    lat, lon = source.frame.to_degrees(east, north).tolist()
    first = max(main, key=lambda row: (int(source.priority[row]), int(source.lanes[row]), -row))
    lanes = max(int(source.lanes[row]) for row in main)
    return PoolRow(
        map_id=map_id(family, extract.code, *ids),
        family=family,
        shape=shape,
        slot=slot,
        lat=round(lat, 6),
        lon=round(lon, 6),
        source=source.name,
        well_tagged=extract.well_tagged,
        osm_ids=tuple(sorted({way for piece in pieces for way in source.osm_ids[piece.row]})),
        junction_ids=tuple(sorted({name for node in junctions for name in osm_nodes(source.node_ids[node])})),
        east=round(east, 1),
        north=round(north, 1),
        half_w=round(half_w, 1),
        half_h=round(half_h, 1),
        lanes=lanes,
        lane_bucket=min(lanes, 3),
        oneway=all(source.opposite[row] < 0 for row in main),
        curvature=round(curvature, 4),
        length_m=round(length_m, 1),
        speed_mps=float(source.speed[first]),
        road_class=source.road_class[first],
        detail=json.dumps(detail, separators=(",", ":")),
    )


def stations(line: Floats) -> Floats:
    """Arc length at each vertex, (n,)."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])


def length(line: Floats) -> float:
    return float(stations(line)[-1])


def point_at(line: Floats, at: float) -> Floats:
    """The point `at` metres along, (2,); clamped to the ends."""
    along = stations(line)
    return np.array([np.interp(at, along, line[:, 0]), np.interp(at, along, line[:, 1])])


def cut(line: Floats, start: float, end: float) -> Floats:
    along = stations(line)
    inner = line[(along > start + 0.05) & (along < end - 0.05)]
    return np.vstack([point_at(line, start), inner, point_at(line, end)])


def densified(line: Floats, step: float) -> Floats:
    """Points every `step` metres at most, both ends included, (k, 2)."""
    along = stations(line)
    at = np.linspace(0.0, along[-1], max(2, int(np.ceil(along[-1] / step)) + 1))
    return np.column_stack([np.interp(at, along, line[:, 0]), np.interp(at, along, line[:, 1])])


def heading_away(line: Floats, span: float = HEADING_SPAN_M) -> float:
    """Direction in which a line leaves its first point, over its first `span` metres."""
    dx, dy = point_at(line, span) - line[0]
    return float(np.degrees(np.arctan2(dy, dx)))


def heading_towards(line: Floats, span: float = HEADING_SPAN_M) -> float:
    """Direction in which a line arrives at its last point, over its last `span` metres."""
    return wrap_deg(heading_away(line[::-1], span) + 180.0)


def chord_over_arc(line: Floats) -> float:
    """1 for a straight line, less for a bend; 0 for a closed one."""
    arc = length(line)
    return float(np.hypot(*(line[-1] - line[0])) / arc) if arc > 0 else 0.0
