"""The lidar against ray casting by brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from planner_loop import load

from tsbench.geometry.footprint import corners
from tsbench.geometry.polyline import Array
from tsbench.learn.rl.ppo_planner import RAYS, REACH_M, Lidar, _cast, _outlines, road_area, road_edges


def brute(lines: list[shapely.LineString], x: float, y: float, heading: float) -> Array:
    """(240,) distances by intersecting every ray with everything."""
    things = shapely.union_all(lines)
    found = []
    for k in range(RAYS):
        angle = heading + 2.0 * math.pi * k / RAYS
        ray = shapely.LineString([(x, y), (x + REACH_M * math.cos(angle), y + REACH_M * math.sin(angle))])
        hit = ray.intersection(things)
        found.append(REACH_M if hit.is_empty else hit.distance(shapely.Point(x, y)))
    return np.array(found)


@pytest.mark.parametrize("seed", range(6))
def test_boxes_are_where_brute_force_sees_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    boxes = np.column_stack(
        (rng.uniform(-60, 60, (12, 2)), rng.uniform(-4, 4, 12), rng.uniform(0.4, 12, 12), rng.uniform(0.4, 3, 12))
    )
    boxes = boxes[np.hypot(boxes[:, 0], boxes[:, 1]) > 8.0]
    x, y, heading = rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-4, 4)
    lines = [shapely.LinearRing(corners(*box)) for box in boxes.tolist()]
    seen = _cast(_outlines(boxes), x, y, heading)
    assert np.abs(seen - brute(lines, x, y, heading)).max() < 1e-6


def test_nothing_around_is_the_reach() -> None:
    assert (_cast(np.empty((4, 0)), 1.0, 2.0, 0.3) == REACH_M).all()


def test_the_outline_of_the_road_encloses_its_lanes() -> None:
    network = load("cross")
    area, edges = road_area(network), road_edges(network)
    assert all(area.buffer(0.3).contains(shapely.LineString(lane.line.points)) for lane in network.lanes)
    outline = shapely.MultiLineString([[(a, b), (c, d)] for a, b, c, d in edges.tolist()])
    assert outline.hausdorff_distance(area.boundary) < 0.5
    assert Lidar(edges)._edges.shape == (4, len(edges))
