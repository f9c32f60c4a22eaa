"""Routes over edges and paths over lanes."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsbench.geometry.polyline import Polyline
from tsbench.roads.lane_graph import Destination, LaneGraph, RoutePath
from tsbench.roads.network import RoadNetwork

END = Destination("bu", 100.0)
SHORT, LONG = ("ta", "ab", "bu"), ("ta", "ad", "dc", "cb", "bu")


@pytest.fixture(scope="module")
def graph(block: RoadNetwork) -> LaneGraph:
    return LaneGraph(block)


def names(network: RoadNetwork, path: RoutePath) -> list[str]:
    return [network.lanes[p.lane].id for p in path.pieces]


def check_smooth(line: Polyline) -> None:
    steps = np.diff(line.points, axis=0)
    turns = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
    assert np.abs(turns).max(initial=0.0) < math.radians(35)
    assert np.hypot(*steps.T).max() < 145.0


def test_routes_are_shortest_and_avoid_what_they_are_told(graph: LaneGraph) -> None:
    assert graph.route("ta", "bu") == SHORT
    assert graph.route("ta", "bu", avoid_turns={("ta", "ab")}) == LONG
    assert graph.route("ta", "bu", avoid_edges={"ab"}) == LONG
    assert graph.route("ta", "bu", avoid_turns={("ab", "bu")}) == LONG
    assert graph.route("ta", "bu", avoid_turns={("ta", "ab"), ("cb", "bu")}) is None
    assert graph.route("ta", "ta") == ("ta",)


def test_what_cannot_be_reached_has_no_route(graph: LaneGraph) -> None:
    assert graph.route("at", "bu") is None
    assert graph.route("ta", "ub") is None


def brute(graph: LaneGraph, source: str, target: str, turns: set, edges: set) -> float:
    """Length of the shortest route by trying every simple one."""
    best = math.inf

    def go(edge: str, cost: float, seen: frozenset[str]) -> None:
        nonlocal best
        if edge == target:
            best = min(best, cost)
            return
        for succ in graph.successors(edge):
            if succ not in seen and succ not in edges and (edge, succ) not in turns:
                way = graph.crossing_length(edge, succ) + graph.network.edges[succ].length
                go(succ, cost + way, seen | {succ})

    go(source, 0.0, frozenset({source}))
    return best


EDGES = ["ta", "at", "ab", "ba", "bc", "cb", "cd", "dc", "da", "ad", "bu", "ub"]
TURNS = st.sets(st.tuples(st.sampled_from(EDGES), st.sampled_from(EDGES)), max_size=8)


@given(st.sampled_from(EDGES), st.sampled_from(EDGES), TURNS, st.sets(st.sampled_from(EDGES), max_size=3))
def test_no_route_is_better_than_the_one_found(
    graph: LaneGraph, source: str, target: str, turns: set, edges: set
) -> None:
    route = graph.route(source, target, turns, edges)
    best = brute(graph, source, target, turns, edges)
    if route is None:
        assert best == math.inf
        return
    assert (route[0], route[-1]) == (source, target)
    length = sum(graph.crossing_length(a, b) + graph.network.edges[b].length for a, b in pairwise(route))
    assert length == pytest.approx(best)
    assert not set(pairwise(route)) & turns
    assert not set(route[1:]) & edges


def test_a_path_without_lane_change_is_the_lanes_themselves(block: RoadNetwork, graph: LaneGraph) -> None:
    path = graph.path(SHORT, block.lane("ta_0").index, 20.0, END)
    assert path is not None
    assert names(block, path) == ["ta_0", ":a_4_0", "ab_0", ":b_4_0", "bu_0"]
    assert path.line.point_at(0.0) == pytest.approx(block.lane("ta_0").line.point_at(20.0))
    assert path.line.point_at(path.destination_s) == pytest.approx(block.lane("bu_0").line.point_at(100.0))
    assert path.limit_at(0.0) == pytest.approx(13.89)
    check_smooth(path.line)


def test_a_lane_change_is_smooth_and_ends_in_the_lane_that_leads_on(block: RoadNetwork, graph: LaneGraph) -> None:
    path = graph.path(LONG, block.lane("ta_0").index, 10.0, END)
    assert path is not None
    assert names(block, path)[:3] == ["ta_1", "ta_1", ":a_5_0"]
    check_smooth(path.line)
    begin, end = block.lane("ta_0").line, block.lane("ta_1").line
    assert path.line.point_at(0.0) == pytest.approx(begin.point_at(10.0))
    along = [end.project(*path.line.point_at(s))[1] for s in np.arange(0.0, 45.0, 1.0)]
    assert along[0] == pytest.approx(-3.2)
    assert along[-1] == pytest.approx(0.0, abs=1e-6)
    assert all(b >= a - 1e-6 for a, b in pairwise(along))


def test_late_on_the_edge_the_change_is_short_but_made(block: RoadNetwork, graph: LaneGraph) -> None:
    length = block.lane("ta_0").line.length
    for left in (30.0, 8.0, 2.0, 0.5):
        path = graph.path(LONG, block.lane("ta_0").index, length - left, END)
        assert path is not None
        assert ":a_5_0" in names(block, path)
        assert path.line.point_at(path.destination_s) == pytest.approx(block.lane("bu_0").line.point_at(100.0))


def test_from_inside_a_junction(block: RoadNetwork, graph: LaneGraph) -> None:
    inner = block.lane(":b_5_0")
    path = graph.path(("bc", "cd"), inner.index, 1.0, Destination("cd", 50.0))
    assert path is not None
    assert names(block, path)[:3] == [":b_5_0", ":b_6_0", "bc_0"]
    assert path.line.point_at(0.0) == pytest.approx(inner.line.point_at(1.0))
    assert path.line.point_at(path.destination_s) == pytest.approx(block.lane("cd_0").line.point_at(50.0))
    assert graph.path(("bu",), inner.index, 1.0, END) is None


def test_edges_that_do_not_follow_each_other_have_no_path(block: RoadNetwork, graph: LaneGraph) -> None:
    assert graph.path(("ta", "bu"), block.lane("ta_0").index, 10.0, END) is None


@given(data=st.data())
def test_the_destination_lies_on_the_path_where_its_edge_has_it(
    block: RoadNetwork, graph: LaneGraph, data: st.DataObject
) -> None:
    route = data.draw(st.sampled_from([SHORT, LONG]))
    k = data.draw(st.integers(0, len(route) - 1))
    last = block.edge_lanes(route[-1])[0].line.length
    end = Destination(route[-1], data.draw(st.floats(5.0, last)))
    lane = data.draw(st.sampled_from(block.edge_lanes(route[k])))
    s = data.draw(st.floats(0.0, lane.line.length - 1.0))
    path = graph.path(route[k:], lane.index, s, end)
    assert path is not None
    expected = block.edge_lanes(end.edge)[0].line.point_at(end.s)
    assert path.line.point_at(path.destination_s) == pytest.approx(expected, abs=0.05)
    # The pieces cover the line without a hole, in order.
    assert path.pieces[0].s0 == 0.0
    assert all(a.s1 == pytest.approx(b.s0) for a, b in pairwise(path.pieces))
    assert path.pieces[-1].s1 == pytest.approx(path.line.length, abs=1e-6)
    assert path.lane_at(path.line.length) == path.pieces[-1].lane
