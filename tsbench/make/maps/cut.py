"""Cuts pieces of a source network into a `PlainNet`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tsbench.make.maps.lines import cut
from tsbench.make.maps.plain import PlainEdge, PlainNet, PlainNode
from tsbench.make.maps.source import SourceNetwork
from tsbench.make.maps.utm import Floats

SAME_END_M = 0.5


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
