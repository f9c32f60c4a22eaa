"""`idm` in a closed loop on small nets; `idm-s1` .. `idm-s4`: which driver is drawn, and how it drives."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planner_loop import Body, World, cones, constant, front_of, ids, load
from work import calls

from tsbench.geometry.footprint import boxes_overlap
from tsbench.planners.geometry import PathSamples, speed_profile
from tsbench.planners.idm import Idm, IdmParameters, IdmS1, IdmS2, IdmS3, IdmS4, draw_style, free_road, interaction
from tsbench.planners.observation import Observation
from tsbench.roads.lane_graph import Destination, LaneGraph
from tsbench.sim.nuplan import quantile_speed
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M, ActorKind

PARAMETERS = IdmParameters()


@pytest.mark.parametrize(
    ("net", "source", "target"),
    [
        ("cross", "sc", "cw"),
        ("cross", "sc", "ce"),
        ("cross", "sc", "cn"),
        ("cross", "ene", "nen"),
        ("ring", "in0", "out1"),
        ("ring", "in0", "out2"),
        ("ring", "in1", "out0"),
    ],
)
def test_keeps_to_its_lane_in_tight_turns_and_arrives(net: str, source: str, target: str) -> None:
    world = World(load(net), f"{source}_0", 30.0, 11.0, Destination(target, 60.0)).run(Idm(), 60.0)
    assert world.arrived
    assert max(abs(d) for d in world.offsets) < 0.35
    assert max(abs(e.speed * e.yaw_rate) for e in world.states) < 4.0


def test_drives_at_the_roads_limit_and_slows_down_for_a_lower_one_ahead() -> None:
    world = World(load("corridor"), "ab_0", 20.0, 11.0, Destination("bd", 100.0)).run(Idm(), 60.0)
    edges = [world.network.lanes[e.lane].edge for e in world.states]
    before = [e.speed for e, edge in zip(world.states, edges, strict=True) if edge == "ab"]
    after = [e.speed for e, edge in zip(world.states, edges, strict=True) if edge == "bd"]
    assert max(before) > 0.95 * 16.67
    assert max(after) < 1.05 * 11.11
    assert min(c.acceleration for c in world.controls) > -PARAMETERS.slowing - 0.01


def test_comes_down_gently_from_above_the_limit() -> None:
    world = World(load("corridor"), "ab_0", 20.0, 21.0, Destination("bd", 100.0)).run(Idm(), 60.0)
    assert min(c.acceleration for c in world.controls) >= -PARAMETERS.slowing
    assert world.states[40].speed < 17.5


@pytest.mark.parametrize("speed", [5.0, 11.0, 16.0])
def test_stops_before_an_obstacle_in_its_lane_and_stays_there(speed: float) -> None:
    network = load("corridor")
    obstacles = cones(network.lane("ab_0"), 110.0)
    world = World(network, "ab_0", 20.0, speed, Destination("bd", 60.0), obstacles=obstacles).run(Idm(), 40.0)
    near_end = 110.0 - 2.25 - 0.2
    assert world.ego.speed < 0.05
    assert 1.0 < near_end - front_of(world.ego) < 4.0
    assert min(c.acceleration for c in world.controls) > -4.0


def test_an_obstacle_on_the_other_lane_is_none() -> None:
    network = load("corridor")
    obstacles = cones(network.lane("ab_1"), 110.0)
    assert World(network, "ab_0", 20.0, 11.0, Destination("bd", 60.0), obstacles=obstacles).run(Idm(), 40.0).arrived


@settings(max_examples=12, deadline=None)
@given(speed=st.floats(3.0, 12.0), gap=st.floats(12.0, 40.0))
def test_settles_at_the_equilibrium_gap_behind_a_steady_leader(speed: float, gap: float) -> None:
    network = load("long")
    leader = Body("lead", ("ab_0",), 20.0 + EGO_LENGTH_M / 2 + gap + 4.5, constant(speed))
    world = World(network, "ab_0", 20.0, speed, Destination("ab", 1900.0), bodies=[leader]).run(Idm(), 70.0)
    free = 1.0 - (speed / 16.67) ** 4
    wanted = (PARAMETERS.min_gap_m + speed * PARAMETERS.headway_s) / math.sqrt(free)
    real = leader.front - 4.5 - front_of(world.states[-1])
    assert world.ego.speed == pytest.approx(speed, abs=0.15)
    assert real == pytest.approx(wanted, rel=0.08, abs=0.3)
    assert min(c.acceleration for c in world.controls) > -6.0


def test_reacts_to_a_pedestrian_on_its_path_but_not_beside_it() -> None:
    network = load("cross")
    for shift, stops in ((0.0, True), (3.0, False)):
        walker = Body("p", ("sc_0",), 80.0, constant(0.0), kind=ActorKind.PEDESTRIAN, length=0.3, width=0.5)
        world = World(network, "sc_0", 20.0, 10.0, Destination("cn", 60.0), bodies=[walker])
        world.lateral["p"] = shift
        world.run(Idm(), 30.0)
        assert world.arrived is not stops


def test_brakes_for_someone_who_crosses_but_not_for_someone_about_to() -> None:
    network = load("cross")
    chain = tuple(ids(network, "wc", "ce"))
    line = network.lane("wc_0").line.length
    waiting = Body("w", chain, line - 0.5, constant(0.0))
    world = World(network, "sc_0", 40.0, 10.0, Destination("cn", 60.0), bodies=[waiting]).run(Idm(), 20.0)
    assert world.arrived
    assert min(c.acceleration for c in world.controls) > -0.5
    across = Body("w", chain, line + 8.0, constant(0.0))
    world = World(network, "sc_0", 40.0, 10.0, Destination("cn", 60.0), bodies=[across]).run(Idm(), 20.0)
    assert not world.arrived
    assert world.ego.speed < 0.05


def test_an_oncoming_car_on_its_own_lane_is_no_reason_to_brake() -> None:
    network = load("cross")
    oncoming = [Body(f"o{k}", ("nc_0",), 20.0 + 25.0 * k, constant(0.0)) for k in range(3)]
    oncoming += [Body(f"q{k}", ("cs_0",), 20.0 + 25.0 * k, constant(0.0)) for k in range(3)]
    world = World(network, "sc_0", 20.0, 10.0, Destination("cn", 60.0), bodies=oncoming).run(Idm(), 30.0)
    assert world.arrived
    assert min(c.acceleration for c in world.controls) > -0.1


def test_brakes_hard_when_the_gap_is_short_but_within_the_vehicle() -> None:
    network = load("cross")
    stopped = Body("s", ("sc_0",), 45.0, constant(0.0))
    world = World(network, "sc_0", 20.0, 12.0, Destination("cn", 60.0), bodies=[stopped]).run(Idm(), 10.0)
    assert min(c.acceleration for c in world.controls) == pytest.approx(-6.0)
    assert front_of(world.ego) < 40.5


def test_profile_brakes_before_a_bend() -> None:
    network = load("cross")
    graph = LaneGraph(network)
    path = graph.path(("sc", "ce"), network.lane_index["sc_0"], 0.0, Destination("ce", 60.0))
    assert path is not None
    speeds = speed_profile(path, PathSamples(path), lateral=2.0, decel=2.0, factor=1.0, top=math.inf)
    slowest = int(np.argmin(speeds))
    assert 2.0 < speeds[slowest] < 5.0
    drop = [(a * a - b * b) / 2.0 for a, b in pairwise(speeds)]
    assert max(drop) < 2.0 + 1e-6


@given(st.floats(0.0, 22.0), st.floats(1.5, 22.0))
def test_free_road_is_bounded_and_zero_at_the_desired_speed(v: float, desired: float) -> None:
    a = free_road(v, desired, PARAMETERS)
    assert -PARAMETERS.slowing <= a <= PARAMETERS.accel
    assert free_road(desired, desired, PARAMETERS) == 0.0


@given(st.floats(0.0, 22.0), st.floats(0.5, 80.0), st.floats(0.0, 22.0))
def test_interaction_grows_as_the_gap_shrinks(v: float, gap: float, lead: float) -> None:
    assert interaction(v, gap, lead, PARAMETERS) >= interaction(v, gap + 1.0, lead, PARAMETERS) >= 0.0


def test_a_tick_is_cheap() -> None:
    network = load("cross")
    bodies = [Body(f"v{k}", ("wc_0",), 5.0 + 9.0 * k, constant(0.0)) for k in range(6)]
    bodies += [Body(f"w{k}", ("cw_0",), 5.0 + 9.0 * k, constant(0.0)) for k in range(6)]
    seen: list[Observation] = []

    class Watching(Idm):
        def act(self, observation: Observation):
            seen.append(observation)
            return super().act(observation)

    planner = Watching()
    World(network, "sc_0", 20.0, 10.0, Destination("cn", 60.0), bodies=bodies).run(planner, 8.0)
    # About 90 calls, 40 us on a quiet machine; twice as many are another planner.
    assert max(calls(lambda o=o: Idm.act(planner, o)) for o in tuple(seen)) < 130


@pytest.mark.parametrize("beside", [True, False])
def test_changes_lanes_with_the_route_but_not_into_somebody(beside: bool) -> None:
    network = load("fork")
    cars = [
        Body(f"b{k}", ("ab_0", ":b_0_0", "bs_0"), 22.0 + 11.0 * k, constant(9.0)) for k in range(4 if beside else 0)
    ]
    world = World(network, "ab_1", 30.0, 9.0, Destination("bs", 60.0), bodies=cars).run(Idm(), 60.0)
    assert world.arrived
    for ego, poses in zip(world.states, world.poses, strict=False):
        for x, y, heading in poses.values():
            assert not boxes_overlap(ego.x, ego.y, ego.heading, EGO_LENGTH_M, EGO_WIDTH_M, x, y, heading, 4.5, 1.8)


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
