"""Contact by footprints."""

from __future__ import annotations

import math

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from simworld import actors

from tsbench.episode.outcome import touched_actor, touched_obstacle
from tsbench.geometry.footprint import corners
from tsbench.sim.scene import Obstacle
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M, EgoState

BODY = st.tuples(
    st.floats(-15, 15), st.floats(-15, 15), st.floats(-math.pi, math.pi), st.floats(0.5, 18), st.floats(0.4, 2.9)
)


def ego(x: float = 0.0, y: float = 0.0, heading: float = 0.0) -> EgoState:
    return EgoState(x, y, heading, 5.0, 0.0, 0.0, 0.0, 0, 0.0, 0.0, True)


def area(x: float, y: float, heading: float, length: float, width: float) -> shapely.Polygon:
    return shapely.Polygon(corners(x, y, heading, length, width))


@given(st.floats(-math.pi, math.pi), st.lists(BODY, max_size=6))
def test_the_first_body_that_overlaps_is_found_and_no_other(heading: float, bodies: list) -> None:
    mine = area(0.0, 0.0, heading, EGO_LENGTH_M, EGO_WIDTH_M)
    depth = [mine.intersection(area(*b)).area for b in bodies]
    apart = [mine.distance(area(*b)) for b in bodies]
    hit = touched_actor(ego(heading=heading), actors(*bodies))
    sure = [k for k, a in enumerate(depth) if a > 1e-6]
    if sure:
        assert 0 <= hit <= sure[0]
    if hit >= 0:
        assert apart[hit] < 1e-6
    assert hit == -1 or not any(depth[k] > 1e-6 for k in range(hit))


@pytest.mark.parametrize("length", [4.5, 12.0, 18.0])
def test_a_gap_of_a_centimetre_is_a_gap(length: float) -> None:
    ahead = (EGO_LENGTH_M + length) / 2
    beside = (EGO_WIDTH_M + 2.5) / 2
    for gap, hit in ((0.01, -1), (-0.01, 0)):
        assert touched_actor(ego(), actors((ahead + gap, 0.0, 0.0, length, 2.5))) == hit
        assert touched_actor(ego(), actors((0.0, beside + gap, math.pi, length, 2.5))) == hit
        assert touched_actor(ego(), actors((-ahead - gap, 0.0, math.pi, length, 2.5))) == hit


def test_obstacles_by_their_own_box() -> None:
    beyond = Obstacle("far", "island", 20.0, 0.0, 0.0, 6.0, 1.6, "road_0")
    turned = Obstacle("near", "cones", 4.0, 0.0, math.pi / 2, 4.9, 0.5, "road_0")
    assert touched_obstacle(ego(), (beyond, turned)) is None
    assert touched_obstacle(ego(x=1.6), (beyond, turned)) is turned
    assert touched_obstacle(ego(x=17.0), (beyond, turned)) is beyond
    assert touched_obstacle(ego(), ()) is None
