"""Where the ego is, from geometry."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from simworld import place

from tsbench.geometry.polyline import Polyline
from tsbench.roads.localization import LaneLocator, inside_polygon
from tsbench.roads.network import RoadNetwork


@pytest.fixture(scope="module")
def on_block_lanes(block: RoadNetwork) -> LaneLocator:
    return LaneLocator(block)


@pytest.fixture(scope="module")
def on_road_lanes(road: RoadNetwork) -> LaneLocator:
    return LaneLocator(road)


def test_inside_polygon_of_a_bent_area() -> None:
    bent = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 4], [0, 4]], dtype=float)
    assert inside_polygon(0.5, 3.0, bent)
    assert inside_polygon(3.0, 0.5, bent)
    assert not inside_polygon(2.0, 2.0, bent)
    assert not inside_polygon(-0.1, 0.5, bent)


@given(data=st.data())
def test_inside_a_strip_the_lane_and_the_frenet_place_are_found(block: RoadNetwork, data: st.DataObject) -> None:
    lane = block.lane(data.draw(st.sampled_from(["ta_0", "ta_1", "ab_0", "ba_0", "bc_0", "dc_0", "bu_0"])))
    s = data.draw(st.floats(0.5, lane.line.length - 0.5))
    d = data.draw(st.floats(-0.49, 0.49)) * lane.width
    x, y, heading = place(block, lane.id, s, d)
    last = data.draw(st.sampled_from([-1, lane.index]))
    index, at, aside, on_road = LaneLocator(block).locate(x, y, heading, last)
    assert (block.lanes[index].id, on_road) == (lane.id, True)
    assert (at, aside) == (pytest.approx(s, abs=1e-6), pytest.approx(d, abs=1e-6))


def test_beside_the_road_is_off_it(road: RoadNetwork, on_road_lanes: LaneLocator) -> None:
    width = road.lane("road_0").width
    for s in (1.0, 150.0, 299.0):
        x, y, heading = place(road, "road_0", s, -(width / 2 + 0.05))
        assert on_road_lanes.locate(x, y, heading, 0) == (-1, 0.0, 0.0, False)
        x, y, heading = place(road, "road_2", s, width / 2 + 0.05)
        assert on_road_lanes.locate(x, y, heading, 2) == (-1, 0.0, 0.0, False)
    for s in (-0.5, 300.5):
        x, y, heading = place(road, "road_1", s)
        assert on_road_lanes.locate(x, y, heading, 1) == (-1, 0.0, 0.0, False)


def test_a_lane_is_kept_up_to_its_edge_and_no_further(road: RoadNetwork, on_road_lanes: LaneLocator) -> None:
    width = road.lane("road_1").width
    for d, there in ((width / 2 - 0.02, 1), (width / 2 + 0.02, 2), (-width / 2 - 0.02, 0)):
        x, y, heading = place(road, "road_1", 100.0, d)
        assert on_road_lanes.locate(x, y, heading, 1)[0] == there
        assert on_road_lanes.locate(x, y, heading, -1)[0] == there


def test_turned_round_it_is_still_on_the_lane_below_it(block: RoadNetwork, on_block_lanes: LaneLocator) -> None:
    x, y, heading = place(block, "ab_0", 60.0)
    against = heading + math.pi
    assert block.lanes[on_block_lanes.locate(x, y, against, -1)[0]].id == "ab_0"


def test_through_a_junction_the_path_that_was_taken_is_kept(
    cross: RoadNetwork, on_cross_paths: dict[str, list[str]]
) -> None:
    for turn, seen in on_cross_paths.items():
        connection = next(c for c in cross.connections if c.via and cross.lanes[c.via[0]].id == turn)
        expected = [connection.from_lane, *connection.via, connection.to_lane]
        assert seen == [cross.lanes[i].id for i in expected]


@pytest.fixture(scope="module")
def on_cross_paths(cross: RoadNetwork) -> dict[str, list[str]]:
    """Lanes that a point sees that drives every connection from the west along its middle."""
    locator, seen = LaneLocator(cross), {}
    for c in cross.connections:
        if cross.lanes[c.from_lane].edge != "w_in":
            continue
        chain = [cross.lanes[i] for i in (c.from_lane, *c.via, c.to_lane)]
        last, names = chain[0].index, []
        for lane in chain:
            begin = lane.line.length - 3.0 if lane is chain[0] else 0.0
            end = 3.0 if lane is chain[-1] else lane.line.length
            for s in np.arange(begin, end, 0.2):
                x, y = lane.line.point_at(s)
                last, _, _, on_road = locator.locate(x, y, lane.line.heading_at(s), last)
                assert on_road
                name = cross.lanes[last].id
                if name not in names[-1:]:
                    names.append(name)
        seen[chain[1].id] = names
    return seen


def test_a_corner_of_a_junction_without_a_path_is_on_the_road(cross: RoadNetwork) -> None:
    locator = LaneLocator(cross)
    area = cross.junctions["x"].polygon
    grid = [(x, y) for x in np.arange(-8, 8, 0.25) for y in np.arange(-8, 8, 0.25)]
    free = [p for p in grid if inside_polygon(*p, area) and locator.locate(*p, 0.0, -1)[0] < 0]
    assert free, "the junction has a place that no path covers"
    assert all(locator.locate(*p, 0.0, -1) == (-1, 0.0, 0.0, True) for p in free)
    assert not locator.locate(9.5, 9.5, 0.0, -1)[3]


def test_a_slit_between_two_lanes_is_on_the_road(road: RoadNetwork, on_road_lanes: LaneLocator) -> None:
    """Lanes of bends part by centimetres: between two lanes of one edge is no place off the road."""
    apart = [
        replace(lane, line=Polyline(lane.line.points + np.array([0.0, 0.2 * lane.order])))
        if not lane.internal
        else lane
        for lane in road.lanes
    ]
    locator = LaneLocator(replace(road, lanes=tuple(apart)))
    middle = apart[0].line.point_at(100.0)[1] + apart[0].width / 2
    for y, lane in ((middle + 0.05, 0), (middle + 0.15, 1)):
        index, s, _, on_road = locator.locate(100.0, y, 0.0, -1)
        assert (index, on_road) == (lane, True)
        assert s == pytest.approx(100.0)
    outside = apart[2].line.point_at(100.0)[1] + apart[2].width / 2
    assert locator.locate(100.0, outside + 0.1, 0.0, -1) == (-1, 0.0, 0.0, False)


def test_a_seam_between_a_lane_and_the_next_is_on_the_road(block: RoadNetwork) -> None:
    """netconvert rounds to centimetres: a lane may end a little before the next one begins, outside the junction."""
    lane = block.lane("bu_0")
    shifted = Polyline(lane.line.points + 0.015 * np.array([math.cos(place(block, "bu_0", 0.0)[2]), 0.0]))
    lanes = tuple(replace(one, line=shifted) if one.id == "bu_0" else one for one in block.lanes)
    bare = {k: replace(j, polygon=np.zeros((0, 2))) for k, j in block.junctions.items()}
    locator = LaneLocator(replace(block, lanes=lanes, junctions=bare))
    x, y, heading = place(block, "bu_0", 0.0075)
    assert locator.locate(x, y, heading, -1)[3]
    x, y, heading = place(block, "bu_0", lane.line.length + 0.2)
    assert not locator.locate(x, y, heading, -1)[3]
