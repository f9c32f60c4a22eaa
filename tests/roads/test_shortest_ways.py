"""Shortest ways, held against every way there is, and their ties."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsbench.roads.lane_graph import shortest_ways, way_to

SIZE = 6
Graph = dict[tuple[int, int], int]
GRAPHS = st.dictionaries(st.tuples(st.integers(0, SIZE - 1), st.integers(0, SIZE - 1)), st.integers(0, 4), max_size=20)


def from_start(graph: Graph, target: int | None = None):  # type: ignore[no-untyped-def]
    def onward(node: int, cost: float) -> Iterator[tuple[int, float]]:
        return ((b, cost + more) for (a, b), more in graph.items() if a == node)

    return shortest_ways(0, onward, target)


def cheapest(graph: Graph) -> list[float]:
    """Costs from node 0 by trying every way with fewer edges than there are nodes."""
    costs = [0.0] + [math.inf] * (SIZE - 1)
    for _ in range(SIZE):
        for (a, b), more in graph.items():
            costs[b] = min(costs[b], costs[a] + more)
    return costs


@given(GRAPHS)
def test_no_way_is_shorter_and_each_is_what_it_costs(graph: Graph) -> None:
    found = from_start(graph)
    assert {k: reached.cost for k, reached in found.items()} == {
        k: cost for k, cost in enumerate(cheapest(graph)) if cost < math.inf
    }
    assert list(found) == sorted(found, key=lambda k: found[k].cost) or any(not more for more in graph.values())
    for node, reached in found.items():
        way = way_to(node, found)
        assert (way[0], way[-1]) == (0, node)
        assert sum(graph[step] for step in pairwise(way)) == reached.cost


@given(GRAPHS, st.integers(0, SIZE - 1))
def test_the_way_to_a_target_is_the_same_when_nothing_beyond_is_looked_for(graph: Graph, target: int) -> None:
    assert way_to(target, from_start(graph, target)) == way_to(target, from_start(graph))


@pytest.mark.parametrize(
    ("graph", "way"),
    [
        ({(0, 2): 1, (0, 1): 1, (2, 3): 1, (1, 3): 1}, [0, 1, 3]),
        ({(0, 1): 2, (0, 2): 1, (2, 3): 2, (1, 3): 1}, [0, 2, 3]),
    ],
)
def test_of_ways_that_cost_the_same_the_one_from_what_was_reached_first_stays(graph: Graph, way: list[int]) -> None:
    assert way_to(3, from_start(graph)) == way


def test_what_cannot_be_reached_has_no_way() -> None:
    assert way_to(4, from_start({(0, 1): 1, (4, 1): 1})) == []
