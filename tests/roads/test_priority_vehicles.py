from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tsbench.roads.junction_paths import junction_paths
from tsbench.roads.network import Connection, RoadNetwork, read_network
from tsbench.roads.priority import EXPERT_FOLLOWING, RULE_FOLLOWING, Following, PriorityVehicle, PriorityVehicles
from tsbench.sim.world import ActorKind, Actors, ActorTable

# Routes over a crossroads whose arms have two lanes each; lengths: arms 89.6 m, fw_in 100 m, way across 20.8 m.
ROUTES = {
    "straight": ("fw_in", "w_in", "e_out"),
    "away": ("w_in",),
    "left": ("fw_in", "w_in", "n_out"),
    "right": ("fw_in", "w_in", "s_out"),
    "other": ("n_in", "s_out"),
}


@cache
def _network() -> RoadNetwork:
    return read_network(Path(__file__).parent.parent / "cases" / "nets" / "x.net.xml")


def _find(
    *placed: tuple[str, str, float], following: Following = RULE_FOLLOWING, only: frozenset[str] | None = None
) -> list[tuple[str, PriorityVehicle]]:
    """Vehicles by route, lane and place of the front: the lane from which the path of each comes, and the rest."""
    net, table = _network(), ActorTable()
    for k, (name, route) in enumerate(ROUTES.items()):
        table.add(name, ActorKind.CAR, 4.0 + k, 1.8, route)
    rows = np.array([table.rows[name] for name, _, _ in placed], dtype=np.int32)
    lanes = np.array([net.lane_index[lane] for _, lane, _ in placed], dtype=np.int32)
    places, speeds = np.array([s for _, _, s in placed]), np.arange(3.0, 3.0 + len(placed))
    actors = Actors(table, rows, np.zeros((len(placed), 3)), speeds, lanes, places)
    paths = junction_paths(net, ("w_in",))
    counted = None if only is None else {net.lane_index[lane] for lane in only}
    found = PriorityVehicles(net, paths, following, counted).find(actors)
    return [(paths[vehicle.path].source.id, vehicle) for vehicle in found]


@pytest.mark.parametrize(
    ("route", "lane", "s", "source", "place"),
    [
        ("straight", "fw_in_1", 36.75, "w_in_1", 36.75 - 100.0 - 0.01 - 89.6),
        ("straight", "fw_in_0", 36.75, "w_in_0", 36.75 - 100.0 - 0.01 - 89.6),
        ("straight", ":W_2_0", 0.04, "w_in_0", 0.004 - 0.01 - 89.6),
        ("straight", ":W_2_1", 0.04, "w_in_1", 0.004 - 0.01 - 89.6),
        ("straight", "w_in_0", 80.0, "w_in_0", -9.6),
        ("straight", ":C_15_1", 3.0, "w_in_1", 3.0),
        ("straight", "e_out_0", 2.0, "w_in_0", 22.8),
        ("straight", "e_out_1", 2.0, "w_in_1", 22.8),
        ("left", "w_in_1", 80.0, "w_in_1", -9.6),
        ("left", "w_in_0", 80.0, "w_in_1", -9.6),
        ("left", "fw_in_0", 90.0, "w_in_1", -99.61),
        ("left", ":C_17_0", 3.0, "w_in_1", 3.0),
        ("left", ":C_21_0", 3.0, "w_in_1", 7.948),
        ("left", "n_out_0", 3.0, "w_in_1", 24.299),
        ("right", "w_in_1", 80.0, "w_in_0", -9.6),
        ("right", ":C_14_0", 3.0, "w_in_0", 3.0),
        ("right", "s_out_0", 3.0, "w_in_0", 12.031),
    ],
)
def test_a_vehicle_is_placed_on_its_way(route: str, lane: str, s: float, source: str, place: float) -> None:
    [(came_from, vehicle)] = _find((route, lane, s))
    assert came_from == source
    assert vehicle.s == pytest.approx(place, abs=0.002)


def test_who_does_not_come_this_way_is_none() -> None:
    assert _find(("straight", "n_in_0", 2.0), ("away", "w_in_0", 80.0), ("other", "n_in_0", 80.0)) == []
    assert _find(("left", ":C_15_0", 2.0), ("straight", "n_out_0", 2.0)) == []


def test_each_vehicle_keeps_its_row_length_and_speed() -> None:
    (_, first), (_, second) = _find(("right", "w_in_0", 10.0), ("away", "w_in_0", 30.0), ("straight", "w_in_1", 50.0))
    assert (first.at, first.row, first.length, first.speed) == (0, 3, 7.0, 3.0)
    assert (second.at, second.row, second.length, second.speed) == (2, 0, 4.0, 5.0)


def _straight_with(outgoing: dict[str, tuple[Connection, ...]], lane: str) -> dict[str, str]:
    """For a rule and an expert: the exit lane of the path that a vehicle on a lane of w_in takes straight on.

    outgoing: the connections of some lanes, in the place of their own. The vehicle goes on to fw_in behind e_out.
    """
    whole, table = _network(), ActorTable()
    table.add("v", ActorKind.CAR, 4.0, 1.8, ("w_in", "e_out", "fw_in"))
    changed = {whole.lane_index[name]: connections for name, connections in outgoing.items()}
    net = replace(whole, outgoing=tuple(changed.get(i, own) for i, own in enumerate(whole.outgoing)))
    at = np.array([net.lane_index[lane]], dtype=np.int32)
    actors = Actors(table, np.zeros(1, np.int32), np.zeros((1, 3)), np.ones(1), at, np.array([80.0]))
    paths, found = junction_paths(net, ("w_in",)), {}
    for name, following in (("rule", RULE_FOLLOWING), ("expert", EXPERT_FOLLOWING)):
        [vehicle] = PriorityVehicles(net, paths, following).find(actors)
        found[name] = paths[vehicle.path].target.id
    return found


def _connection(source: str, target: str) -> Connection:
    net = _network()
    return next(c for c in net.outgoing[net.lane_index[source]] if c.to_lane == net.lane_index[target])


def test_only_an_expert_looks_whether_a_lane_leads_on_to_where_a_vehicle_goes() -> None:
    onward = replace(_connection("fw_in_0", "w_in_0"), to_lane=_network().lane_index["fw_in_0"])
    assert _straight_with({}, "w_in_1") == {"rule": "e_out_1", "expert": "e_out_1"}
    assert _straight_with({"e_out_0": (onward,)}, "w_in_1") == {"rule": "e_out_1", "expert": "e_out_0"}


def test_of_two_paths_from_one_lane_a_rule_takes_the_leftmost_and_an_expert_the_rightmost() -> None:
    right, left = _connection("w_in_0", "e_out_0"), _connection("w_in_1", "e_out_1")
    both = (right, replace(left, from_lane=right.from_lane))
    assert _straight_with({"w_in_0": both, "w_in_1": ()}, "w_in_0") == {"rule": "e_out_1", "expert": "e_out_0"}


def test_a_rule_looks_150_metres_upstream_and_an_expert_as_far_as_the_route_goes() -> None:
    far = Following(scaled=True, upstream_m=10.0, onward=False, leftmost=True)
    assert _find(("straight", "fw_in_1", 36.75), following=far) == []
    assert len(_find(("straight", "w_in_1", 3.0), following=far)) == 1
    assert (RULE_FOLLOWING.upstream_m, EXPERT_FOLLOWING.upstream_m) == (150.0, float("inf"))


def test_on_lanes_that_do_not_count_nobody_has_priority() -> None:
    placed = (("straight", "w_in_1", 80.0), ("straight", ":C_15_1", 3.0))
    [(_, vehicle)] = _find(placed[0], only=frozenset({"w_in_1"}))
    assert vehicle.s == pytest.approx(-9.6, abs=0.002)
    assert _find(placed[1], only=frozenset({"w_in_1"})) == []
