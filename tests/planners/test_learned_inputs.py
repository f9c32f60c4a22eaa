"""What `ppo` and `carl` see: the right things in the right places, and no sign."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from learned_scenes import SPEED, Recorder, with_signs

from tsbench.learn.rl.carl_planner import DRIVABLE, EGO, LIGHTS, LIMITS, OTHERS, ROUTE, STOPS, VEHICLES, RasterEncoder
from tsbench.learn.rl.ppo_planner import NEIGHBOURS, RAYS, SIZE, VectorEncoder


@pytest.fixture
def vectors(drive: Recorder) -> VectorEncoder:
    encoder = VectorEncoder()
    encoder.reset(drive.context)
    return encoder


@pytest.fixture
def rasters(drive: Recorder) -> RasterEncoder:
    encoder = RasterEncoder()
    encoder.reset(drive.context)
    return encoder


def test_the_vector_has_its_layout(drive: Recorder, vectors: VectorEncoder) -> None:
    for o in drive.seen:
        v = vectors.encode(o)
        assert v.shape == (SIZE,) == (275,)
        assert v.dtype == np.float32
        assert np.abs(v).max() <= 1.5
    v = vectors.encode(drive.seen[0])
    assert v[0] == pytest.approx(SPEED / 22.2, abs=1e-5)
    # The leader's front is 25 m ahead of the ego's centre, and has moved for one tick.
    assert 50.0 * v[SIZE - 240] == pytest.approx(25.8 - 4.5, abs=0.05)
    # The walker comes closest soonest, then the first of the cones, then the leader, who keeps his distance.
    walker, cone, leader, nobody = v[-RAYS - NEIGHBOURS : -RAYS].reshape(4, 4)
    assert 50.0 * walker[0] == pytest.approx(15.0 - 0.2, abs=0.05)
    assert 50.0 * walker[1] == pytest.approx(-4.0, abs=0.05)
    assert 20.0 * walker[2] == pytest.approx(-SPEED, abs=0.05)
    assert (50.0 * cone[:2]).tolist() == pytest.approx([37.75, 0.0], abs=0.05)
    assert 50.0 * leader[0] == pytest.approx(25.8 - 2.25, abs=0.05)
    assert np.abs(leader[1:]).max() < 0.02
    assert nobody.tolist() == [1.0, 0.0, 0.0, 0.0]


def test_the_walker_is_seen_to_the_right(drive: Recorder, vectors: VectorEncoder) -> None:
    rays = vectors.encode(drive.seen[0])[-240:] * 50.0
    at = math.atan2(-4.0, 15.0 - 0.2)
    seen = rays[round(at / (2 * math.pi / 240)) % 240]
    assert seen <= math.hypot(15.0, 4.0) + 0.3


def test_no_number_tells_of_a_sign(drive: Recorder, vectors: VectorEncoder, rasters: RasterEncoder) -> None:
    for o in drive.seen[::5]:
        other = with_signs(o)
        assert vectors.encode(o).tobytes() == vectors.encode(other).tobytes()
        for a, b in zip(rasters.encode(o), rasters.encode(other), strict=True):
            assert a.tobytes() == b.tobytes()


def test_the_raster_shows_what_is_there(drive: Recorder, rasters: RasterEncoder) -> None:
    image, measured = rasters.encode(drive.seen[0])
    assert image.shape == (9, 128, 128)
    assert image.dtype == np.uint8
    assert measured.shape == (10,)
    ahead = image[:, :96, 64]
    assert (ahead[DRIVABLE, 40:] == 255).all()
    assert (ahead[ROUTE, 40:] == 255).all()
    assert (ahead[LIMITS, 60:] > 100).all()
    # 22.75 m ahead is the leader's middle: 45 pixels above row 96; cones from 37 m on: at most row 24.
    assert image[VEHICLES, 96 - 45, 64] > 150
    assert image[VEHICLES, 96 - 20, 64] == 0
    assert image[OTHERS, :30, 62:67].any()
    # The walker stands 15 m ahead and 4 m to the right.
    assert image[OTHERS, 64:70, 70:75].any()
    assert not image[LIGHTS].any()
    assert not image[STOPS].any()
    assert image[EGO, 96, 64] == 255
    # Outlines belong to a shape: half a pixel all round.
    assert 4.5 * 1.85 < image[EGO].sum() / 255 / 4 < 5.5 * 2.85


def test_the_raster_turns_with_the_ego(drive: Recorder, rasters: RasterEncoder) -> None:
    o = replace(drive.seen[0], ego=replace(drive.seen[0].ego, heading=drive.seen[0].ego.heading + math.pi / 2))
    image = rasters.raster(o)
    # Heading left by 90 degrees, what was ahead is to the right; the walker on the right is behind.
    assert image[VEHICLES, 96, 64 + 45] > 150
    assert image[ROUTE, 96, 70:100].min() > 200
    assert image[OTHERS, 100:107, 90:98].any()


def test_a_fast_car_is_brighter_and_has_a_trail(drive: Recorder, rasters: RasterEncoder) -> None:
    o = drive.seen[0]
    still = replace(o, actors=replace(o.actors, speed=np.zeros(len(o.actors))))
    moving, standing = rasters.raster(o)[VEHICLES], rasters.raster(still)[VEHICLES]
    assert moving[51, 64] > standing[51, 64] > 0
    # A second at 8 m/s, from the front at 25 m on.
    assert moving[96 - 56, 62:67].any()
    assert not standing[96 - 56].any()
