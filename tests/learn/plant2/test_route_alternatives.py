"""The ways on that `plant2-ft` is shown: one by each exit that leads to the destination."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from learned_scenes import Recorder
from planner_loop import load

from tsbench.learn.plant2 import tokens as at
from tsbench.learn.plant2.plant2_planner import RouteAlternatives
from tsbench.planners.observation import Observation
from tsbench.roads.lane_graph import Destination, LaneGraph, MapGraph
from tsbench.sim.navigation import Navigator

POINTS = slice(0, 2 * len(at.WAY_AHEAD_M))
COS, SIN, EXIT, REMAINING, SHOWN = range(-at.WAY_FACTS, 0)


@pytest.fixture(scope="module")
def graph(drive: Recorder) -> MapGraph:
    return drive.context.graph


def seen_from(o: Observation, ways: RouteAlternatives) -> at.Record:
    record_: at.Records = np.zeros(1, dtype=at.SIGN_TOKENS)
    ways.watch(o)
    ways.fill(record_[0], (o.ego.x, o.ego.y, o.ego.heading))
    return record_[0]


def on_lane(drive: Recorder, graph: MapGraph, lane: str, s: float, target: Destination) -> Observation:
    o, index = drive.seen[0], graph.network.lane(lane).index
    line = graph.network.lane(lane).line
    x, y = line.point_at(s)
    ego = replace(o.ego, x=x, y=y, heading=line.heading_at(s), lane=index, s=s)
    return replace(o, ego=ego, route=Navigator(graph, target).update(ego))


def test_each_exit_that_leads_there_has_a_way(drive: Recorder, graph: MapGraph) -> None:
    target = Destination("nw", 10.0)
    seen = seen_from(on_lane(drive, graph, "sc_0", 20.0, target), RouteAlternatives(graph, target))
    known = seen["ways"][: int(seen["way_known"].sum())]
    assert len(known) == 3
    turns = np.degrees(np.arctan2(known[:, SIN], known[:, COS])).round()
    assert sorted(turns.tolist()) == pytest.approx([-90.0, 0.0, 90.0], abs=2.0)
    assert known[:, SHOWN].tolist() == [float(abs(turn) < 45.0) for turn in turns]
    assert (np.diff(known[:, REMAINING]) >= 0.0).all()
    to_exit = graph.network.lane("sc_0").line.length - 20.0
    assert known[:, EXIT] * at.POSITION_SCALE_M == pytest.approx([to_exit] * 3, abs=0.5)


def test_points_lie_on_the_way_and_turn_with_the_pose(drive: Recorder, graph: MapGraph) -> None:
    target = Destination("nw", 10.0)
    end = graph.network.lane("sc_0").line.length
    o = on_lane(drive, graph, "sc_0", end - 5.0, target)
    known = seen_from(o, RouteAlternatives(graph, target))["ways"][:3]
    for way in known:
        points = way[POINTS].reshape(-1, 2) * at.POSITION_SCALE_M
        assert points[3] == pytest.approx([4.0, 0.0], abs=0.1)
        turn = math.atan2(way[SIN], way[COS])
        assert math.copysign(1.0, points[-1, 1]) == math.copysign(1.0, turn) or abs(turn) < 0.1
    turned = np.zeros(1, dtype=at.SIGN_TOKENS)
    ways = RouteAlternatives(graph, target)
    ways.watch(o)
    ways.fill(turned[0], (o.ego.x, o.ego.y, o.ego.heading + math.pi / 2))
    assert turned[0]["ways"][0, 0:2] == pytest.approx([known[0, 1], -known[0, 0]], abs=1e-6)


def test_an_exit_without_a_way_on_is_left_out(drive: Recorder) -> None:
    fork, target = LaneGraph(load("fork")), Destination("be", 20.0)
    assert set(fork.successors("ab")) == {"be", "bs"}
    seen = seen_from(on_lane(drive, fork, "ab_0", 5.0, target), RouteAlternatives(fork, target))
    assert seen["way_known"].tolist() == [1, 0, 0, 0], "from bs no way leads there"
    assert seen["ways"][0, SHOWN] == 1.0
    own = Destination("ab", 15.0)
    seen = seen_from(on_lane(drive, fork, "ab_0", 5.0, own), RouteAlternatives(fork, own))
    assert seen["way_known"].tolist() == [1, 0, 0, 0], "its own edge: the way along it"
    assert seen["ways"][0, REMAINING] * at.REMAINING_SCALE_M == pytest.approx(10.0, abs=0.1)


def test_ways_are_kept_inside_a_junction_and_followed(drive: Recorder, graph: MapGraph) -> None:
    target = Destination("nw", 10.0)
    ways = RouteAlternatives(graph, target)
    first = seen_from(on_lane(drive, graph, "sc_0", 20.0, target), ways)
    later = seen_from(on_lane(drive, graph, "sc_0", 30.0, target), ways)
    gone = (first["ways"][:3, REMAINING] - later["ways"][:3, REMAINING]) * at.REMAINING_SCALE_M
    assert gone == pytest.approx([10.0] * 3, abs=0.1)
    inner = next(c.via[0] for c in graph.connections("sc", "cn"))
    before = ways.ways
    seen_from(on_lane(drive, graph, graph.network.lanes[inner].id, 1.0, target), ways)
    assert ways.ways is before
    seen_from(on_lane(drive, graph, "cn_0", 1.0, target), ways)
    assert ways.ways is not before


@pytest.mark.parametrize("to_exit", [5.0, 30.0])
def test_the_way_that_a_plan_leads_to_is_meant(drive: Recorder, graph: MapGraph, to_exit: float) -> None:
    """Others are told only where the plan leads beyond the exit, by another than the navigation's."""
    target, end = Destination("nw", 10.0), graph.network.lane("sc_0").line.length
    ways = RouteAlternatives(graph, target)
    seen_from(on_lane(drive, graph, "sc_0", end - to_exit, target), ways)
    for way in ways.ways:
        ways._intended = next(w for w in ways.ways if w.shown)
        x, y = way.line.point_at(way.s + 20.0)
        told = to_exit < 20.0 and not way.shown
        assert ways.intent(x, y, 20.0) == (way.edges if told else ())
        assert (way.edges[0], way.edges[-1]) == ("sc", "nw")


def test_who_meant_a_way_goes_on_with_it_where_ways_run_together(drive: Recorder, graph: MapGraph) -> None:
    target, end = Destination("nw", 10.0), graph.network.lane("sc_0").line.length
    ways = RouteAlternatives(graph, target)
    seen_from(on_lane(drive, graph, "sc_0", end - 5.0, target), ways)
    turn, straight = (next(w for w in ways.ways if w.shown is shown) for shown in (False, True))
    together, apart = turn.line.point_at(turn.s + 6.0), turn.line.point_at(turn.s + 20.0)
    assert ways.intent(*together, 6.0) == ()
    assert ways.intent(*apart, 20.0) == turn.edges
    assert ways.intent(*together, 6.0) == turn.edges
    assert ways.intent(*straight.line.point_at(straight.s + 20.0), 20.0) == ()


def test_off_the_navigations_way_nothing_is_told(drive: Recorder, graph: MapGraph) -> None:
    assert RouteAlternatives(graph, Destination("nw", 10.0)).intent(0.0, 0.0, 20.0) == ()
