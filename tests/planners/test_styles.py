"""`idm-s1` .. `idm-s4`: who is drawn, and how they drive."""

from __future__ import annotations

import numpy as np
import pytest
from planner_loop import Body, World, constant, load

from tsbench.planners.idm import Idm, IdmS1, IdmS2, IdmS3, IdmS4, draw_style
from tsbench.roads.lane_graph import Destination
from tsbench.sim.nuplan import quantile_speed

STYLES = (IdmS1, IdmS2, IdmS3, IdmS4)
# km/h, docs/planners.md.
CRUISE_KMH = {IdmS1: (11, 20), IdmS2: (19, 32), IdmS3: (31, 44.5), IdmS4: (43.5, 62.5)}


@pytest.mark.parametrize("style", STYLES)
def test_drivers_fill_their_band_and_no_more(style: type) -> None:
    drivers = [draw_style(style.band, seed) for seed in range(400)]
    low, high = CRUISE_KMH[style]
    cruise = np.array([d.top_speed for d in drivers]) * 3.6
    assert low - 0.5 <= cruise.min() < cruise.max() <= high + 0.5
    assert cruise.max() - cruise.min() > 0.9 * 3.6 * (quantile_speed(style.band[1]) - quantile_speed(style.band[0]))
    for values, least, most in (
        ([d.min_gap_m for d in drivers], 2.0, 10.0),
        ([d.headway_s for d in drivers], 0.8, 2.5),
        ([d.accel for d in drivers], 0.5, 4.0),
        ([d.decel for d in drivers], 0.5, 5.0),
    ):
        assert least <= min(values) < least + 0.1 * (most - least)
        assert most - 0.1 * (most - least) < max(values) <= most
    # One rank stands behind both: who keeps the wider gap also keeps the longer headway.
    ranks = [((d.min_gap_m - 2.0) / 8.0, (d.headway_s - 0.8) / 1.7) for d in drivers]
    assert all(a == pytest.approx(b) for a, b in ranks)


def test_the_seed_alone_decides() -> None:
    for style in STYLES:
        assert draw_style(style.band, 7) == draw_style(style.band, 7) != draw_style(style.band, 8)


@pytest.mark.parametrize("style", STYLES)
def test_cruises_at_its_own_speed_or_the_roads_limit(style: type) -> None:
    world = World(load("long"), "ab_0", 20.0, 8.0, Destination("ab", 1900.0)).run(style(), 60.0)
    cruise = draw_style(style.band, 1).top_speed  # the loop's seed
    assert world.ego.speed == pytest.approx(min(cruise, 16.67), rel=0.05)


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("target", ["cw", "ce"])
def test_the_laziest_brakes_too_keep_the_lane_in_turns(style: type, target: str) -> None:
    """b is how hard a driver likes to brake for others; a bend is slowed down for as sharply as it takes."""
    lazy = draw_style(style.band, 1)
    object.__setattr__(lazy, "decel", 0.5)
    object.__setattr__(lazy, "accel", 0.5)
    world = World(load("cross"), "sc_0", 40.0, 11.0, Destination(target, 60.0)).run(Idm(lazy), 60.0)
    assert world.arrived
    assert max(abs(d) for d in world.offsets) < 0.35


@pytest.mark.parametrize("style", STYLES)
def test_never_runs_into_a_leader(style: type) -> None:
    stopped = Body("s", ("ab_0",), 120.0, constant(0.0))
    world = World(load("long"), "ab_0", 20.0, 11.0, Destination("ab", 1900.0), bodies=[stopped]).run(style(), 60.0)
    assert world.ego.s + 2.26 < 115.5
    assert world.ego.speed < 0.1
