"""Shortest ways over a graph of numbered nodes."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple


class Reached(NamedTuple):
    """A node that can be reached. cost: of the shortest way to it. before: the node before it, -1 for the first."""

    cost: float
    before: int


def shortest_ways(
    start: int, onward: Callable[[int, float], Iterable[tuple[int, float]]], target: int | None = None
) -> dict[int, Reached]:
    """Every node that can be reached from `start`, nearest first, by Dijkstra's algorithm.

    onward: of a node and what it costs to get there, each node after it with what it costs to get to that, not less.
    target: nothing beyond it is looked for. Of nodes at the same cost, the one with the lower number comes first; of
    ways to a node at the same cost, the one that comes from the node reached earlier is kept.
    """
    best, queue = {start: Reached(0.0, -1)}, [(0.0, start)]
    found: dict[int, Reached] = {}
    while queue and target not in found:
        cost, node = heapq.heappop(queue)
        if node in found:
            continue
        found[node] = best[node]
        for following, total in onward(node, cost):
            if following not in best or total < best[following].cost:
                best[following] = Reached(total, node)
                heapq.heappush(queue, (total, following))
    return found


def way_to(target: int, found: Mapping[int, Reached]) -> list[int]:
    """Nodes of the shortest way to `target`, both ends included; none where it cannot be reached."""
    way: list[int] = []
    while target in found:
        way.append(target)
        target = found[target].before
    return way[::-1]
