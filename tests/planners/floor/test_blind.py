"""The floors: how they are told apart, what plates are to them, and what they make of posts and of the start."""

from __future__ import annotations

import math

import pytest
from planner_loop import Body, World, ids, load, long_road, plate

from tsbench.core.seeds import floor_seed
from tsbench.planners import registry
from tsbench.planners.base import Control, PlannerContext
from tsbench.planners.floor.constraints import least_speed, limit_of
from tsbench.planners.floor.guess import Blind, Coin
from tsbench.planners.idm import Idm
from tsbench.planners.observation import Observation, SignView
from tsbench.roads.lane_graph import Destination
from tsbench.sim.world import EGO_LENGTH_M

KMH = 1.0 / 3.6
HALF_M = EGO_LENGTH_M / 2


def test_floors_are_flagged_and_lead_nobody() -> None:
    floors = [name for name in registry.names() if registry.entry(name).floor]
    assert floors == ["blind", "codes", "coin", "plant2-blind"]
    for name in floors:
        loaded = registry.resolve(name)
        assert (loaded.floor, loaded.privileged, loaded.sign_access) == (True, False, name == "codes")


class Witnessed(Blind):
    """Keeps what the driver is shown."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[Observation] = []

    def drive(self, seen: Observation) -> Control:
        self.seen.append(seen)
        return super().drive(seen)


def test_no_plate_reaches_it() -> None:
    driver = Witnessed()
    long_road(plate("3.24", 20.0, 130.0)).run(driver, 1.0)
    for seen in driver.seen:
        (post,) = seen.signs
        assert (post.code, post.value, post.edge, post.lane, post.x) == ("", None, "", -1, 130.0)
        assert math.isnan(post.position_m)
        assert seen.truth is None


@pytest.mark.parametrize("driver", [Blind, Coin])
def test_what_hangs_on_a_post_changes_nothing(driver: type[Blind]) -> None:
    drives = [
        long_road(sign).run(driver(), 8.0).controls
        for sign in (plate("3.24", 20.0, 130.0), plate("5.31", 70.0, 130.0), plate("3.24", 20.0, 130.0).masked())
    ]
    assert drives[0] == drives[1] == drives[2]


def test_a_post_alone_makes_it_slow() -> None:
    """49 km/h to 20.9 before the post; without one it drives as `idm` does."""
    bare, idm = (long_road().run(d, 8.0).controls for d in (Blind(), Idm()))
    assert bare == idm
    posted = long_road(plate("3.24", 40.0, 130.0)).run(Blind(), 25.0)
    within = [e.speed for e in posted.states if 130.0 < e.x + HALF_M < 240.0]
    assert within
    assert max(within) <= 21.0 * KMH
    assert min(within) > 20.0 * KMH


def test_the_start_tells_the_limit() -> None:
    """A scene starts so much above its limit; the road's own limit as a start says nothing."""
    assert [limit_of(v * KMH + 7.75) for v in (20.0, 30.0, 40.0)] == [20.0, 30.0, 40.0]
    assert limit_of(50.0 * KMH) == 20.0
    assert [least_speed((v - 12.0) * KMH) for v in (40.0, 50.0, 60.0)] == [40.0, 50.0, 60.0]
    assert least_speed(30.0 * KMH) is None


@pytest.mark.parametrize("led", [True, False])
def test_a_leader_excuses_who_is_slow(led: bool) -> None:
    """Minimum 50 on one plate, 40 on the other: 40.9 behind a leader, as fast as may be without one."""
    leader = Body("leader", ("ab_0",), 50.0 + HALF_M + 25.0 + 4.5, lambda t, w: 44.0 * KMH)
    post = plate("4.6", 50.0, 50.0 + HALF_M + 30.0)
    world = long_road(post, speed=38.0 * KMH, bodies=(leader,) if led else ()).run(Blind(), 12.0)
    late = [e.speed / KMH for e in world.states if e.x > 150.0]
    assert late
    assert (max(late) < 41.0) is led


def test_it_takes_the_other_way_at_a_fork() -> None:
    """Straight on is the navigation's way; it turns off and comes round the block."""
    world = World(load("cross"), "sc_0", 30.0, 8.0, Destination("nne", 60.0)).run(Blind(), 120.0)
    assert world.arrived
    lanes = world.network.lanes
    driven = dict.fromkeys(lanes[e.lane].edge for e in world.states if not lanes[e.lane].internal)
    assert list(driven) == ["sc", "cw", "wn", "nne"]


def junction(slows: bool) -> World:
    """A post at the line, and from the left one who is there 1.5 s after the ego, or begins to brake for it late."""
    network = load("cross")
    line = network.lane("sc_0").line

    def speed(_: float, world: World) -> float:
        to_go = line.length - world.ego.s - HALF_M
        return max(other.now - 0.3, 0.0) if slows and to_go < 5.0 else 8.0

    other = Body("w", tuple(ids(network, "wc", "ce")), 43.0, speed, ("wc", "ce"), now=8.0)
    x, y = line.point_at(line.length - 3.0)
    post = SignView("2.4", None, x + 4.0, y, line.heading_at(0.0), "sc", -1, line.length - 3.0, 50.0)
    start = line.length - 62.0
    return World(network, "sc_0", start, 8.0, Destination("cn", 60.0), [other], signs=(post,))


@pytest.mark.parametrize("slows", [True, False])
def test_it_makes_a_full_stop_at_a_junction_whatever_who_comes_does(slows: bool) -> None:
    world = junction(slows).run(Blind(), 60.0)
    assert world.arrived
    before = [e.speed for e in world.states if e.lane == world.network.lane_index["sc_0"]]
    assert min(before) < 0.2


def test_a_coin_is_thrown_in_each_half() -> None:
    """Over many pairs: half of its throws are each way, and halves agree as often as not."""
    throws = {half: [_obeys(floor_seed(f"pair-{k}{half}")) for k in range(400)] for half in ("", "-c")}
    for seen in throws.values():
        assert 160 < sum(seen) < 240
    agree = sum(a == b for a, b in zip(throws[""], throws["-c"], strict=True))
    assert 160 < agree < 240


def _obeys(seed: int) -> bool:
    world = long_road()
    context = PlannerContext(seed, world.view.map, world.view.graph, world.destination, 0.1)
    coin = Coin()
    coin.reset(context)
    return coin.obeys
