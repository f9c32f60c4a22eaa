"""What scenes on a corridor share: its road cut into edges of their own. Units: m."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from tsbench.dataset.maps.plain import PlainConnection, PlainEdge, PlainNet, PlainNode
from tsbench.geometry.polyline import Polyline


def split_edge(plain: PlainNet, edge_id: str, cuts: Sequence[float]) -> tuple[PlainNet, tuple[str, ...]]:
    """Cut an edge at arc lengths (m), lane for lane; returns the net and the parts' ids `<edge>.0`, `.1`, ..."""
    edge = next(e for e in plain.edges if e.id == edge_id)
    line = Polyline(edge.shape)
    ends = [0.0, *cuts, line.length]
    parts, nodes, links = [], [], []
    for k, (a, b) in enumerate(pairwise(ends)):
        shape = tuple((float(x), float(y)) for x, y in line.slice(a, b).points)
        source = edge.source if k == 0 else f"{edge_id}.cut{k}"
        target = edge.target if b == line.length else f"{edge_id}.cut{k + 1}"
        parts.append(replace(edge, id=f"{edge_id}.{k}", source=source, target=target, shape=shape))
        if k:
            x, y = line.point_at(a)
            nodes.append(PlainNode(f"{edge_id}.cut{k}", x, y))
            links += [
                PlainConnection(f"{edge_id}.{k - 1}", f"{edge_id}.{k}", i, i) for i in range(edge.num_lanes)
            ]
    edges: list[PlainEdge] = [e for e in plain.edges if e.id != edge_id] + parts
    connections = [c for c in plain.connections if edge_id not in (c.source, c.target)]
    net = replace(plain, nodes=(*plain.nodes, *nodes), edges=tuple(edges), connections=(*connections, *links))
    return net, tuple(p.id for p in parts)
