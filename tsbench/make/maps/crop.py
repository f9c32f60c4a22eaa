"""Cuts the crop of a pool row out of its source network.

Legs of a ring become one edge each, up to the line, with room between the two carriageways of an arm: where a two-way
road splits in front of a ring, OSM has one edge for the road and one for each branch; where it is a dual one, its
carriageways are often drawn nearer to each other than their lanes are wide.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from tsbench.core.errors import InputError
from tsbench.geometry.elementary import wrap_deg
from tsbench.make.maps.corridors import corridor_pieces, find_corridors
from tsbench.make.maps.dual_paths import dual_path_pieces, find_dual_paths
from tsbench.make.maps.junctions import find_junctions, junction_pieces
from tsbench.make.maps.pieces import EdgePiece, assemble, cut, densified, heading_away, heading_towards, length
from tsbench.make.maps.plain import PlainEdge, PlainNet
from tsbench.make.maps.roundabouts import find_roundabouts, roundabout_chains, roundabout_pieces
from tsbench.make.maps.source import SourceNetwork
from tsbench.make.maps.utm import Floats
from tsbench.scenarios.map_pool import PoolRow


@dataclass(frozen=True)
class Family:
    """`find` yields a source's maps and counts what it refused; `pieces` cuts one by its row's detail."""

    find: Callable[[SourceNetwork, Counter[str]], Iterator[PoolRow]]
    pieces: Callable[[SourceNetwork, dict[str, Any]], list[EdgePiece]]


REGISTRY: dict[str, Family] = {
    "junction": Family(find_junctions, junction_pieces),
    "roundabout": Family(find_roundabouts, roundabout_pieces),
    "dual_path": Family(find_dual_paths, dual_path_pieces),
    "corridor": Family(find_corridors, corridor_pieces),
}


def plain_crop(row: PoolRow, source: SourceNetwork) -> PlainNet:
    """The crop as plain elements: edge and node ids of the source, metres around the crop's centre.

    Dead ends made by a cut are called `<edge id>.start` or `.end` after the edge that was cut there.
    """
    if source.name != row.source:
        raise InputError(f"{row.map_id}: cut from '{row.source}', not from '{source.name}'")
    detail = row.fields
    try:
        pieces = REGISTRY[row.family].pieces(source, detail)
    except KeyError as missing:
        raise InputError(
            f"{row.map_id}: no edge {missing} in this '{source.name}'; "
            f"the pool is from another version of the extract, run `tsbench maps harvest`"
        ) from missing
    if row.family != "roundabout":
        return assemble(source, pieces)
    plain = merge_chains(assemble(source, pieces, [detail["ring"]]), roundabout_chains(detail))
    return part_carriageways(plain, detail["arms"])


STEP_M = 2.0
# Kept between the carriageways of an arm.
BETWEEN_M = 0.2
SMOOTH_STEPS = 3
# At most so much of an edge goes with the corner of a joint.
_MOST_SHARE = 0.4


def merge_chains(plain: PlainNet, chains: Sequence[tuple[Sequence[str], str]]) -> PlainNet:
    """Each chain (edge ids in driving order, the one to keep) becomes one edge with that one's id and lanes.

    A chain that shares an edge with another stays as it is. Nodes without edges go.
    """
    plain = part_carriageways(plain, _branches(plain, chains))
    by_id = {edge.id: edge for edge in plain.edges}
    used = [name for names, _ in chains for name in names]
    merged: dict[str, PlainEdge] = {}
    gone: set[str] = set()
    for names, kept in chains:
        if len(names) > 1 and all(used.count(name) == 1 for name in names):
            merged[kept] = _joined([by_id[name] for name in names], by_id[kept])
            gone.update(name for name in names if name != kept)
    edges = tuple(merged.get(edge.id, edge) for edge in plain.edges if edge.id not in gone)
    ends = {end for edge in edges for end in (edge.source, edge.target)}
    return replace(plain, edges=edges, nodes=tuple(node for node in plain.nodes if node.id in ends))


def part_carriageways(plain: PlainNet, pairs: Sequence[tuple[str, str]]) -> PlainNet:
    """Two edges of one road in opposite directions, each moved to its right where they lie over each other."""
    lines = {edge.id: np.array(edge.shape, dtype=float) for edge in plain.edges}
    by_id = {edge.id: edge for edge in plain.edges}
    for names in pairs:
        if any(by_id[name].spread != "center" for name in names):
            continue
        dense = [densified(lines[name], STEP_M) for name in names]
        room = sum(_half(by_id[name]) for name in names) + BETWEEN_M
        for name, line, other in zip(names, dense, dense[::-1], strict=True):
            apart = shapely.distance(shapely.points(line), shapely.linestrings(other))
            lacking = np.maximum(room - apart, 0.0) / 2
            if lacking.any():
                lines[name] = _shifted(line, lacking)
    return replace(plain, edges=tuple(replace(edge, shape=_rounded(lines[edge.id])) for edge in plain.edges))


def _branches(plain: PlainNet, chains: Sequence[tuple[Sequence[str], str]]) -> list[tuple[str, str]]:
    """Edges of the chains that meet at a joint of two of them, the one towards it first: where a road splits."""
    by_id = {edge.id: edge for edge in plain.edges}
    joints = {by_id[name].target for names, _ in chains for name in names[:-1]}
    members = [by_id[name] for names, _ in chains if len(names) > 1 for name in names]
    return [
        (one.id, other.id)
        for one in members
        for other in members
        if one.target in joints and other.source == one.target and other.target != one.source
    ]


def _joined(chain: Sequence[PlainEdge], kept: PlainEdge) -> PlainEdge:
    half = _half(kept)
    line = _middle(chain[0], half)
    for edge in chain[1:]:
        line = _bridged(line, _middle(edge, half), half)
    return replace(
        kept, source=chain[0].source, target=chain[-1].target, shape=_rounded(_smoothed(line)), spread="center"
    )


def _smoothed(line: Floats) -> Floats:
    """Without kinks: each vertex the mean of those around it, fewer towards the ends, which stay."""
    dense = densified(line, STEP_M)
    last = len(dense) - 1
    reach = [min(k, last - k, SMOOTH_STEPS) for k in range(last + 1)]
    return np.array([dense[k - r : k + r + 1].mean(axis=0) for k, r in enumerate(reach)])


def _rounded(line: Floats) -> tuple[tuple[float, float], ...]:
    return tuple((round(float(x), 2), round(float(y), 2)) for x, y in line)


def _half(edge: PlainEdge) -> float:
    return edge.num_lanes * (edge.width or 0.0) / 2


def _middle(edge: PlainEdge, half: float) -> Floats:
    """The middle of an edge's lanes, (k, 2): `half` right of a line that is its left side."""
    line = np.array(edge.shape, dtype=float)
    return line if edge.spread == "center" else _shifted(line, np.full(len(line), half))


def _shifted(line: Floats, right: Floats) -> Floats:
    """A line moved to its right by so many metres at each vertex."""
    steps = np.diff(line, axis=0)
    normal = np.column_stack([steps[:, 1], -steps[:, 0]]) / np.hypot(*steps.T)[:, None]
    at_vertex = np.vstack([normal[:1], (normal[:-1] + normal[1:]) / 2, normal[-1:]])
    # The mitre of a bend: as far from both sides, but no spike.
    scale = np.maximum(np.einsum("ij,ij->i", at_vertex, at_vertex), 0.5)
    result: Floats = line + right[:, None] * at_vertex / scale[:, None]
    return result


def _bridged(before: Floats, after: Floats, half: float) -> Floats:
    """Two lines as one; where the joint bends, its corner on the inner side is cut off."""
    bend = np.radians(abs(wrap_deg(heading_away(after, STEP_M) - heading_towards(before, STEP_M))))
    corner = half * float(np.tan(min(bend, np.pi / 2) / 2)) + STEP_M / 4
    one, other = length(before), length(after)
    first = cut(before, 0.0, one - min(corner, _MOST_SHARE * one))
    return np.vstack([first, cut(after, min(corner, _MOST_SHARE * other), other)])
