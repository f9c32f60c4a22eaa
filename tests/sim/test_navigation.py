"""Navigation keeps to its route until the ego has left it, and never loses count."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from simworld import ego_at

from tsbench.roads.lane_graph import Destination, LaneGraph
from tsbench.roads.network import RoadNetwork
from tsbench.sim.navigation import Navigator, RouteView

END = Destination("bu", 100.0)


@pytest.fixture(scope="module")
def graph(block: RoadNetwork) -> LaneGraph:
    return LaneGraph(block)


def follow(block: RoadNetwork, n: Navigator, lanes: list[str], d: float = 0.0) -> list[RouteView]:
    """Drive along lanes from end to end, a metre at a time."""
    views = []
    for name in lanes:
        length = block.lane(name).line.length
        views += [n.update(ego_at(block, name, float(s), 5.0, d)) for s in np.arange(0.2, length, 1.0)]
    return views


@given(st.floats(-1.2, 1.2))
def test_on_the_route_the_path_stands_and_progress_is_monotone(block: RoadNetwork, graph: LaneGraph, d: float) -> None:
    n = Navigator(graph, END)
    views = follow(block, n, ["ta_0", ":a_4_0", "ab_0", ":b_4_0", "bu_0"], d)
    assert len({id(v.path) for v in views}) == 1
    s = np.array([v.s for v in views])
    assert (np.diff(s) > 0).all()
    assert [v.d for v in views] == pytest.approx([d] * len(views), abs=0.05)
    remaining = np.array([v.remaining for v in views])
    assert (np.diff(remaining) <= 0).all()
    assert remaining[0] == pytest.approx(views[0].path.destination_s, abs=0.5)
    assert remaining[-1] == 0.0
    gone = views[-1].path.destination_s - s
    assert remaining == pytest.approx(np.maximum(gone, 0.0))


def test_the_wrong_way_out_of_a_junction_gives_a_new_route(block: RoadNetwork, graph: LaneGraph) -> None:
    n = Navigator(graph, END)
    first = follow(block, n, ["ta_0"])[-1]
    assert first.path.edges == ("ta", "ab", "bu")
    aside = follow(block, n, ["ta_1"])[-1]
    # Beside the route on its own edge: the route now leads from this lane, which has to change back.
    assert aside.path.edges == ("ta", "ab", "bu")
    assert block.lanes[aside.path.pieces[-1].lane].id == "bu_0"
    after = follow(block, n, [":a_5_0", ":a_6_0", "ad_0"])
    assert {v.path.edges for v in after[-100:]} == {("ad", "dc", "cb", "bu")}
    ahead = 139.6 + 143.6 + 139.6
    assert after[-100].remaining > ahead - 50
    assert all(math.isfinite(v.remaining) for v in after)
    onward = follow(block, n, [":d_1_0", "dc_0", ":c_1_0", "cb_0", ":b_1_0", "bu_0"])
    assert len({id(v.path) for v in onward}) == 1
    assert onward[-1].remaining == 0.0


def test_a_route_may_begin_inside_a_junction(block: RoadNetwork, graph: LaneGraph) -> None:
    n = Navigator(graph, Destination("cd", 50.0))
    view = n.update(ego_at(block, ":b_6_0", 2.0, 5.0))
    assert view.path.edges == ("bc", "cd")
    assert view.s == pytest.approx(0.0, abs=1e-6)
    assert view.remaining == pytest.approx(view.path.destination_s)


def test_where_there_is_no_way_it_says_so_and_keeps_its_line(block: RoadNetwork, graph: LaneGraph) -> None:
    n = Navigator(graph, END)
    kept = follow(block, n, ["ta_0"])[-1].path
    lost = n.update(ego_at(block, "at_0", 60.0, 5.0))
    assert math.isinf(lost.remaining)
    assert lost.path is kept
    assert math.isfinite(lost.s)


def test_who_comes_back_to_the_route_has_a_way_again(block: RoadNetwork, graph: LaneGraph) -> None:
    """Round something over the lane of oncoming traffic, from which no way leads to the destination."""
    n = Navigator(graph, END)
    follow(block, n, ["ta_0", ":a_4_0"])
    before = n.update(ego_at(block, "ab_0", 40.0, 5.0))
    against = ego_at(block, "ba_0", block.lane("ba_0").line.length - 60.0, 5.0)
    assert n.update(against).remaining == math.inf or n.update(against).path.edges[0] == "ba"
    after = n.update(ego_at(block, "ab_0", 80.0, 5.0))
    assert after.remaining == pytest.approx(before.remaining - 40.0, abs=0.5)


def test_off_the_lanes_the_route_stands(block: RoadNetwork, graph: LaneGraph) -> None:
    n = Navigator(graph, END)
    before = n.update(ego_at(block, "ta_0", 40.0, 5.0))
    e = ego_at(block, "ta_0", 42.0, 5.0, d=-2.5)
    off = type(e)(e.x, e.y, e.heading, e.speed, 0.0, 0.0, 0.0, -1, 0.0, 0.0, False)
    view = n.update(off)
    assert view.path is before.path
    assert view.s == pytest.approx(before.s + 2.0, abs=1e-6)
    assert view.d == pytest.approx(-2.5)


def test_a_start_without_a_way_is_an_error(block: RoadNetwork, graph: LaneGraph) -> None:
    with pytest.raises(ValueError, match="no route from the start to edge bu"):
        Navigator(graph, END).update(ego_at(block, "at_0", 10.0))
