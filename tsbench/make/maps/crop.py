"""Cuts the crop of a pool row out of its source network, and lints crops.

Legs of a ring become one edge each, up to the line, with room between the two carriageways of an arm: where a two-way
road splits in front of a ring, OSM has one edge for the road and one for each branch; where it is a dual one, its
carriageways are often drawn nearer to each other than their lanes are wide.

For the lint a few hundred crops are built as one network of separate parts, then judged singly. What a crop must offer
(`Expectations`) follows from its pool row.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from sumolib.net import readNet
from sumolib.net.lane import Lane

from tsbench.core.errors import InputError
from tsbench.geometry.elementary import SUMO_TURNS, wrap_deg
from tsbench.make.maps.dual_paths import dual_path_pieces, find_dual_paths
from tsbench.make.maps.junctions_and_corridors import corridor_pieces, find_corridors, find_junctions, junction_pieces
from tsbench.make.maps.netconvert import build_net, sumo_binary, sumo_environment
from tsbench.make.maps.pieces import EdgePiece, assemble, cut, densified, heading_away, heading_towards, length
from tsbench.make.maps.plain import PlainEdge, PlainNet
from tsbench.make.maps.roundabouts import find_roundabouts, roundabout_chains, roundabout_pieces
from tsbench.make.maps.source import SourceNetwork
from tsbench.make.maps.utm import Floats
from tsbench.scenarios.map_pool import PoolRow

STEP_M = 2.0
# Kept between the carriageways of an arm.
BETWEEN_M = 0.2
SMOOTH_STEPS = 3
# At most so much of an edge goes with the corner of a joint.
_MOST_SHARE = 0.4
CELL_M = 4000.0
CELLS_PER_ROW = 24
MIN_LANE_M = 8.0
APPROACH_LANE_M = 63.0  # ego's front 60 m before the line, and a little behind it
CORRIDOR_LANE_M = 145.0
WIDTHS_M = (2.5, 4.6)
# Lanes are drawn 0.25 m narrower on each side, so that neighbours that touch do not count.
SHRINK_M = 0.25
MAX_OVERLAP_M2 = 1.0
LOAD_TIMEOUT_S = 120.0


@dataclass(frozen=True)
class Expectations:
    """Least lane length by edge (metres), edge-to-edge links that must exist, turn classes of some links."""

    min_lane_m: dict[str, float]
    links: list[tuple[str, str]] = field(default_factory=list)
    turns: dict[tuple[str, str], str] = field(default_factory=dict)


def _expect_junction(row: PoolRow) -> Expectations:
    arms = row.fields["arms"]
    edges = [edge for arm in arms for edge in (arm["in_edge"], arm["out_edge"]) if edge]
    links = [
        (one["in_edge"], other["out_edge"])
        for one in arms
        for other in arms
        if one is not other and one["in_edge"] and other["out_edge"]
    ]
    return Expectations(dict.fromkeys(edges, MIN_LANE_M), links)


def _expect_roundabout(row: PoolRow) -> Expectations:
    detail = row.fields
    ring = detail["ring"]
    links = list(pairwise([*ring, ring[0]]))
    # A leg is one edge of the crop, the one at the ring; others' queues on it must not reach the ring.
    legs = [leg["edges"][-1] for leg in detail["entries"]] + [leg["edges"][0] for leg in detail["exits"]]
    return Expectations(dict.fromkeys(legs, MIN_LANE_M), links)


def _expect_dual_path(row: PoolRow) -> Expectations:
    detail = row.fields
    signed = detail["signed_edge"]
    ways = [[signed, *detail["short"]], [signed, *detail["compliant"]]]
    links = [link for way in ways for link in pairwise(way)]
    lanes = {edge: MIN_LANE_M for way in ways for edge in way} | {signed: APPROACH_LANE_M}
    base, _, compliant = row.slot.partition("_")
    turns = {(signed, ways[0][1]): base, (signed, ways[1][1]): compliant}
    return Expectations(lanes, links, turns)


def _expect_corridor(row: PoolRow) -> Expectations:
    edges = [edge for edge in (row.fields["edge"], row.fields["opposite"]) if edge]
    return Expectations(dict.fromkeys(edges, CORRIDOR_LANE_M))


@dataclass(frozen=True)
class Family:
    """`find` yields a source's maps and counts what it refused; `pieces` cuts one by its row's detail.

    expect: what the lint asks of a row's crop.
    """

    find: Callable[[SourceNetwork, Counter[str]], Iterator[PoolRow]]
    pieces: Callable[[SourceNetwork, dict[str, Any]], list[EdgePiece]]
    expect: Callable[[PoolRow], Expectations]


REGISTRY: dict[str, Family] = {
    "junction": Family(find_junctions, junction_pieces, _expect_junction),
    "roundabout": Family(find_roundabouts, roundabout_pieces, _expect_roundabout),
    "dual_path": Family(find_dual_paths, dual_path_pieces, _expect_dual_path),
    "corridor": Family(find_corridors, corridor_pieces, _expect_corridor),
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


def lint_crops(crops: Sequence[tuple[PlainNet, Expectations]]) -> list[str]:
    """For each crop why it is refused, or "" if it is sound.

    A crop that netconvert or SUMO cannot take is found by halving the batch.
    """
    if not crops:
        return []
    with tempfile.TemporaryDirectory(prefix="tsbench-lint-") as folder:
        net = Path(folder) / "batch.net.xml"
        try:
            build_net(_together([plain for plain, _ in crops]), net)
            network = readNet(str(net), withFoes=False)
            failure = "" if loads_in_sumo(net) else "SUMO does not load it"
        except InputError:
            failure = "netconvert refuses it"
    if failure:
        half = len(crops) // 2
        return lint_crops(crops[:half]) + lint_crops(crops[half:]) if half else [failure]
    lanes: list[list[Lane]] = [[] for _ in crops]
    turns: list[dict[tuple[str, str], str]] = [{} for _ in crops]
    for edge in network.getEdges():
        index, name = _split(edge.getID())
        lanes[index] += edge.getLanes()
        for target, links in edge.getOutgoing().items():
            turns[index][name, _split(target.getID())[1]] = links[-1].getDirection()
    overlapping = _overlaps(lanes)
    return [
        _judge(lanes[index], turns[index], plain, wanted)
        or ("lanes overlap outside junctions" * (index in overlapping))
        for index, (plain, wanted) in enumerate(crops)
    ]


def loads_in_sumo(net: Path) -> bool:
    """Whether SUMO loads a network and makes a step; in a child process, which may die of it."""
    # By its name in its folder: SUMO splits names at commas.
    options = f"--net-file {net.name} --end 1 --no-step-log --xml-validation never".split()
    command = [str(sumo_binary("sumo")), *options]
    try:
        done = subprocess.run(
            command, cwd=net.parent, env=sumo_environment(), capture_output=True, timeout=LOAD_TIMEOUT_S, check=False
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def _judge(lanes: list[Lane], turns: dict[tuple[str, str], str], plain: PlainNet, wanted: Expectations) -> str:
    built = {_edge(lane) for lane in lanes}
    if any(edge.id not in built for edge in plain.edges):
        return "netconvert dropped an edge"
    if any(not WIDTHS_M[0] <= lane.getWidth() <= WIDTHS_M[1] for lane in lanes):
        return "implausible lane width"
    for lane in lanes:
        least = wanted.min_lane_m.get(_edge(lane), 0.0)
        if lane.getLength() < least:
            return "a used lane is shorter than 8 m" if least <= MIN_LANE_M else "too little room before the junction"
    if any(link not in turns for link in wanted.links):
        return "an arm or way cannot be reached"
    if any(SUMO_TURNS.get(turns[link], "")[:1] != turn for link, turn in wanted.turns.items()):
        return "SUMO's direction differs from the heading change"
    return ""


def _overlaps(lanes_of: list[list[Lane]]) -> set[int]:
    """Crops in which lanes of different edges lie over each other, by number."""
    lanes = [lane for crop in lanes_of for lane in crop]
    owner = np.repeat(np.arange(len(lanes_of)), [len(crop) for crop in lanes_of])
    points = [lane.getShape() for lane in lanes]
    lines = shapely.linestrings(
        np.concatenate(points), indices=np.repeat(np.arange(len(lanes)), [len(line) for line in points])
    )
    half = np.array([lane.getWidth() / 2 - SHRINK_M for lane in lanes])
    bands = shapely.buffer(lines, half, cap_style="flat", join_style="mitre")
    one, other = shapely.STRtree(bands).query(bands, predicate="intersects")
    edges = np.array([_edge(lane) for lane in lanes])
    pair = (one < other) & (owner[one] == owner[other]) & (edges[one] != edges[other])
    one, other = one[pair], other[pair]
    area = shapely.area(shapely.intersection(bands[one], bands[other]))
    return set(owner[one[area > MAX_OVERLAP_M2]].tolist())


def _together(plains: Sequence[PlainNet]) -> PlainNet:
    """All crops as one network: ids with the crop's number before them, places far enough apart."""
    if len(plains) == 1:
        return _moved(plains[0], 0)
    parts = [_moved(plain, index) for index, plain in enumerate(plains)]
    return PlainNet(
        nodes=tuple(node for part in parts for node in part.nodes),
        edges=tuple(edge for part in parts for edge in part.edges),
        connections=(),
        roundabouts=tuple(ring for part in parts for ring in part.roundabouts),
        data=parts[0].data,
    )


def _moved(plain: PlainNet, index: int) -> PlainNet:
    dx, dy = (index % CELLS_PER_ROW) * CELL_M, (index // CELLS_PER_ROW) * CELL_M
    mark = f"{index}~"
    return replace(
        plain,
        nodes=tuple(replace(node, id=mark + node.id, x=node.x + dx, y=node.y + dy) for node in plain.nodes),
        edges=tuple(
            replace(
                edge,
                id=mark + edge.id,
                source=mark + edge.source,
                target=mark + edge.target,
                shape=tuple((x + dx, y + dy) for x, y in edge.shape),
            )
            for edge in plain.edges
        ),
        roundabouts=tuple(tuple(mark + edge for edge in ring) for ring in plain.roundabouts),
    )


def _split(name: str) -> tuple[int, str]:
    index, _, rest = name.partition("~")
    return int(index), rest


def _edge(lane: Lane) -> str:
    """The id that the lane's edge has in its crop."""
    return _split(lane.getEdge().getID())[1]
