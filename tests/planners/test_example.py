"""The README's planner, and the helpers that it uses."""

from __future__ import annotations

from pathlib import Path

import pytest
from planner_loop import KMH, Body, World, cones, constant, front_of, load, target_plate, verdict

import tsbench
from tsbench.planners.observation import SignView
from tsbench.planners.registry import resolve
from tsbench.roads.lane_graph import Destination

EXAMPLE = Path(tsbench.__file__).parent.parent / "examples" / "minimal_planner.py"


def drive(**kwargs: object) -> World:
    world = World(load("long"), "ab_0", 20.0, 14.0, Destination("ab", 600.0), **kwargs)  # type: ignore[arg-type]
    return world.run(resolve(f"{EXAMPLE}:Minimal").factory(), 90.0)


def test_it_drives_at_the_limit_and_arrives() -> None:
    world = drive()
    assert world.arrived
    assert max(e.speed for e in world.states) == pytest.approx(16.67, abs=0.3)


def test_it_stops_for_what_is_ahead() -> None:
    network = load("long")
    assert 0.5 < 297.55 - front_of(drive(obstacles=cones(network.lane("ab_0"), 300.0)).ego) < 5.0
    leader = Body("lead", ("ab_0",), 60.0, constant(6.0))
    world = drive(bodies=[leader])
    assert min(e.speed for e in world.states) > 4.0
    assert leader.front - 4.5 - front_of(world.ego) > 5.0


def test_it_obeys_a_speed_limit() -> None:
    lane = load("long").lane("ab_0").line
    (px, py), (ex, ey) = lane.point_at(200.0, -3.0), lane.point_at(400.0, -3.0)
    signs = (
        SignView("3.24", 30.0, px, py, 0.0, "ab", -1, 200.0, 1.0),
        SignView("3.25", 30.0, ex, ey, 0.0, "ab", -1, 400.0, 1.0),
    )
    world = drive(signs=signs, target=target_plate("3.24", "ab", 30.0, 200.0, zone_edges="ab"))
    assert world.arrived
    inside = [e.speed * KMH for e in world.states if 201.0 < front_of(e) < 399.0]
    assert 27.0 < min(inside) <= max(inside) < 31.0
    assert max(e.speed * KMH for e in world.states if front_of(e) > 450.0) > 40.0
    assert [v.clause for v in verdict(world).violations] == ["over_limit"]  # the end plate is not in that scene


def test_every_name_exists() -> None:
    assert all(getattr(tsbench, name) for name in tsbench.__all__)
    with pytest.raises(AttributeError, match="no attribute 'Nope'"):
        _ = tsbench.Nope
