"""Quality lint of crops: a few hundred are built as one network of separate parts, then judged singly.

What a crop must offer (`Expectations`) follows from its pool row; the lint compares it with the finished network.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from sumolib.net import readNet
from sumolib.net.lane import Lane

from tsbench.core.errors import InputError
from tsbench.geometry.elementary import SUMO_TURNS
from tsbench.make.maps.netconvert import build_net, sumo_binary, sumo_environment
from tsbench.make.maps.plain import PlainNet
from tsbench.scenarios.map_pool import PoolRow

CELL_M = 4000.0
CELLS_PER_ROW = 24
MIN_LANE_M = 8.0
WIDTHS_M = (2.5, 4.6)
# Lanes are drawn 0.25 m narrower on each side, so that neighbours that touch do not count.
SHRINK_M = 0.25
MAX_OVERLAP_M2 = 1.0
LOAD_TIMEOUT_S = 120.0


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


USED_LANE_M = 8.0
APPROACH_LANE_M = 63.0  # ego's front 60 m before the line, and a little behind it
CORRIDOR_LANE_M = 145.0


@dataclass(frozen=True)
class Expectations:
    """Least lane length by edge (metres), edge-to-edge links that must exist, turn classes of some links."""

    min_lane_m: dict[str, float]
    links: list[tuple[str, str]] = field(default_factory=list)
    turns: dict[tuple[str, str], str] = field(default_factory=dict)


def expectations(row: PoolRow) -> Expectations:
    return _BY_FAMILY[row.family](row, row.fields)


def _junction(_: PoolRow, detail: dict[str, Any]) -> Expectations:
    arms = detail["arms"]
    edges = [edge for arm in arms for edge in (arm["in_edge"], arm["out_edge"]) if edge]
    links = [
        (one["in_edge"], other["out_edge"])
        for one in arms
        for other in arms
        if one is not other and one["in_edge"] and other["out_edge"]
    ]
    return Expectations(dict.fromkeys(edges, USED_LANE_M), links)


def _roundabout(_: PoolRow, detail: dict[str, Any]) -> Expectations:
    ring = detail["ring"]
    links = list(pairwise([*ring, ring[0]]))
    # A leg is one edge of the crop, the one at the ring (`crop`); others' queues on it must not reach the ring.
    legs = [leg["edges"][-1] for leg in detail["entries"]] + [leg["edges"][0] for leg in detail["exits"]]
    return Expectations(dict.fromkeys(legs, USED_LANE_M), links)


def _dual_path(row: PoolRow, detail: dict[str, Any]) -> Expectations:
    signed = detail["signed_edge"]
    ways = [[signed, *detail["short"]], [signed, *detail["compliant"]]]
    links = [link for way in ways for link in pairwise(way)]
    lanes = {edge: USED_LANE_M for way in ways for edge in way} | {signed: APPROACH_LANE_M}
    base, _, compliant = row.slot.partition("_")
    turns = {(signed, ways[0][1]): base, (signed, ways[1][1]): compliant}
    return Expectations(lanes, links, turns)


def _corridor(_: PoolRow, detail: dict[str, Any]) -> Expectations:
    edges = [edge for edge in (detail["edge"], detail["opposite"]) if edge]
    return Expectations(dict.fromkeys(edges, CORRIDOR_LANE_M))


_BY_FAMILY: dict[str, Callable[[PoolRow, dict[str, Any]], Expectations]] = {
    "junction": _junction,
    "roundabout": _roundabout,
    "dual_path": _dual_path,
    "corridor": _corridor,
}
