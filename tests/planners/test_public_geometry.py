"""What `tsbench` exports for planners of one's own: the ego's limits, lanes as areas, the route as a line, history."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from planner_loop import Body, World, constant, load

import tsbench
from tsbench.planners.base import PlannerContext
from tsbench.planners.observation import Observation
from tsbench.roads.lane_graph import Destination
from tsbench.roads.road_map import MapLane
from tsbench.sim.ego import Motion, advance
from tsbench.sim.world import DT_S, Agents

END = Destination("ab", 600.0)


class Asking:
    """Drives straight on, and keeps what it is given."""

    def __init__(self) -> None:
        self.seen: list[Observation] = []

    def reset(self, context: PlannerContext) -> None:
        self.context = context

    def act(self, o: Observation) -> tsbench.Control:
        self.seen.append(o)
        return tsbench.Control(0.0, tsbench.pursue_route(o))


def drive(net: str, lane: str, s: float, destination: Destination, **given: object) -> Asking:
    planner = Asking()
    World(load(net), lane, s, 8.0, destination, **given).run(planner, 4.0)  # type: ignore[arg-type]
    return planner


def test_the_limits_are_those_that_commands_are_clipped_to() -> None:
    ego = tsbench.EGO
    fast = advance(Motion(0.0, 0.0, 0.0, 10.0), 99.0, 99.0)
    assert fast.acceleration == pytest.approx(ego.acceleration)
    assert fast.steering == pytest.approx(ego.steering_rate * DT_S)
    assert advance(Motion(0.0, 0.0, 0.0, 10.0), -99.0, 0.0).acceleration == pytest.approx(-ego.braking)
    assert advance(Motion(0.0, 0.0, 0.0, ego.top_speed), 3.0, 0.0).speed == ego.top_speed
    turned = advance(Motion(0.0, 0.0, 0.0, 5.0, steering=ego.steering), 0.0, 99.0)
    assert turned.steering == ego.steering
    assert turned.yaw_rate == pytest.approx(5.0 * math.tan(ego.steering) / ego.wheelbase)
    assert (ego.length, ego.width) == (4.515, 1.852)


def lane_of(*points: tuple[float, float]) -> MapLane:
    lane = drive("long", "ab_0", 20.0, END).context.network.lane("ab_0")
    return replace(lane, line=type(lane.line)(points), width=3.0)


def test_a_lane_as_an_area() -> None:
    lane = lane_of((0.0, 0.0), (10.0, 0.0), (10.0, 10.0))
    left, right = tsbench.lane_bounds(lane)
    assert left == pytest.approx(np.array([(0.0, 1.5), (8.5, 1.5), (8.5, 10.0)]))
    assert right == pytest.approx(np.array([(0.0, -1.5), (11.5, -1.5), (11.5, 10.0)]))
    assert tsbench.lane_polygon(lane) == pytest.approx(np.concatenate((left, right[::-1])))


def test_the_route_as_lanes() -> None:
    asked = drive("cross", "wc_0", 60.0, Destination("cn", 80.0))
    roads, path = asked.context.network, asked.seen[0].route.path
    west, inside, north = (roads.lanes[k] for k in tsbench.route_lanes(path))
    # On the map wc is one road with nw, from which only a bend parts it.
    assert (west.id, inside.internal, north.id) == ("nw_0", True, "cn_0")
    assert (west.index, inside.index, north.index) == tuple(piece.lane for piece in path.pieces)


def test_a_lane_change_is_on_the_new_lane_and_begins_on_the_old() -> None:
    asked = drive("fork", "ab_0", 20.0, Destination("be", 60.0))
    roads, o = asked.context.network, asked.seen[0]
    lanes = tsbench.route_lanes(o.route.path)
    assert roads.lanes[lanes[0]].id == "ab_1"
    assert len(lanes) == len(set(lanes))
    found = tsbench.route_line(asked.context, o, behind=15.0)
    # Behind the ego it lies in the middle of the lane that the ego is on.
    x, y = found.line.point_at(5.0)
    assert abs(roads.lane("ab_0").line.project(x, y)[1]) < 0.01


@pytest.mark.parametrize("lane", ["wc_0", "ec_0"])
def test_the_route_as_a_line_from_behind_the_ego_to_past_the_destination(lane: str) -> None:
    asked = drive("cross", lane, 12.0, Destination("cn", 100.0))
    o, path = asked.seen[-1], asked.seen[-1].route.path
    found = tsbench.route_line(asked.context, o, behind=25.0, past=40.0)
    assert found.start == 25.0
    assert found.line.length == pytest.approx(found.destination_s + 40.0)
    for s in (0.0, 60.0, path.destination_s):
        assert found.line.point_at(found.start + s) == pytest.approx(path.line.point_at(s), abs=1e-6)
    at = found.start + o.route.s
    assert np.hypot(*np.subtract(found.line.point_at(at, o.route.d), (o.ego.x, o.ego.y))) < 1e-6
    # Of its lane 12 m are behind the start, then comes what leads there or, where the net ends, straight on: no gap.
    steps = np.array([found.line.point_at(s) for s in np.arange(0.0, found.line.length, 1.0)])
    assert np.hypot(*np.diff(steps, axis=0).T) == pytest.approx(1.0, abs=0.15)
    # Past the destination it stays on lanes as long as there are some.
    ahead = asked.context.network
    place = found.line.point_at(found.destination_s + 15.0)
    assert min(abs(k.line.project(*place)[1]) for k in ahead.lanes) < 0.01


def test_where_the_road_ends_the_line_goes_straight_on() -> None:
    asked = drive("long", "ab_0", 10.0, Destination("ab", 1990.0))
    found = tsbench.route_line(asked.context, asked.seen[0], behind=30.0, past=50.0)
    assert found.line.length == pytest.approx(30.0 + 1980.0 + 50.0)
    assert found.line.point_at(0.0)[0] == pytest.approx(-20.0)
    assert found.line.point_at(found.line.length)[0] == pytest.approx(2040.0)


def agents(*rows: tuple[int, float]) -> Agents:
    """Agents by id, at x, all else by it."""
    none, x = Agents.none(), np.array([x for _, x in rows])
    return replace(
        none, ids=np.array([k for k, _ in rows], dtype=np.int32), pose=np.column_stack((x, -x, 0 * x)), speed=2 * x
    )


def test_history_of_those_in_sight() -> None:
    history = tsbench.ActorHistory(ticks=3)
    o = drive("long", "ab_0", 20.0, END).seen[0]
    told = [agents((1, 10.0)), agents((1, 11.0), (4, 40.0)), agents((4, 41.0)), agents((1, 13.0), (4, 42.0))]
    found = [history.update(replace(o, actors=seen)) for seen in told]
    assert [one.shape for one in found] == [(1, 3, 4), (2, 3, 4), (1, 3, 4), (2, 3, 4)]
    assert np.isnan(found[0][0, :2]).all()
    assert found[0][0, 2].tolist() == [10.0, -10.0, 0.0, 20.0]
    assert found[1][0, 1:, 0].tolist() == [10.0, 11.0]
    # Out of sight for a tick; what is older than three ticks is gone.
    first, fourth = found[3]
    assert (first[0, 0], np.isnan(first[1, 0]), first[2, 0]) == (11.0, True, 13.0)
    assert fourth[:, 3].tolist() == [80.0, 82.0, 84.0]
    assert history.update(replace(o, actors=Agents.none())).shape == (0, 3, 4)


def test_two_seconds_of_a_leader() -> None:
    leader = Body("lead", ("ab_0",), 60.0, constant(6.0))
    asked, history = drive("long", "ab_0", 20.0, END, bodies=[leader]), tsbench.ActorHistory()
    found = [history.update(o) for o in asked.seen][-1]
    assert found.shape == (1, 20, 4)
    assert np.diff(found[0, :, 0]) == pytest.approx(0.6)
    assert found[0, -1, :3] == pytest.approx(asked.seen[-1].actors.pose[0])
