from __future__ import annotations

import numpy as np
import pytest
from labelled import network

from tsbench.rules.foes import Foe, FoeFinder
from tsbench.rules.paths import junction_paths
from tsbench.sim.world import ActorKind, Actors, ActorTable

# Routes over a crossroads whose arms have two lanes each; lengths: arms 89.6 m, fw_in 100 m, way across 20.8 m.
ROUTES = {
    "straight": ("fw_in", "w_in", "e_out"),
    "away": ("w_in",),
    "left": ("fw_in", "w_in", "n_out"),
    "right": ("fw_in", "w_in", "s_out"),
    "other": ("n_in", "s_out"),
}


def _find(*placed: tuple[str, str, float]) -> list[tuple[str, Foe]]:
    """Vehicles by route, lane and place of the front: the lane from which the path of each comes, and the rest."""
    net, table = network("x"), ActorTable()
    for k, (name, route) in enumerate(ROUTES.items()):
        table.add(name, ActorKind.CAR, 4.0 + k, 1.8, route)
    rows = np.array([table.rows[name] for name, _, _ in placed], dtype=np.int32)
    lanes = np.array([net.lane_index[lane] for _, lane, _ in placed], dtype=np.int32)
    places, speeds = np.array([s for _, _, s in placed]), np.arange(3.0, 3.0 + len(placed))
    actors = Actors(table, rows, np.zeros((len(placed), 3)), speeds, lanes, places)
    paths = junction_paths(net, "w_in")
    found = FoeFinder(net, paths).find(actors)
    return [(net.lanes[paths[foe.path].connection.from_lane].id, foe) for foe in found]


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
    [(came_from, foe)] = _find((route, lane, s))
    assert came_from == source
    assert foe.s == pytest.approx(place, abs=0.002)


def test_who_does_not_come_this_way_is_none() -> None:
    assert _find(("straight", "n_in_0", 2.0), ("away", "w_in_0", 80.0), ("other", "n_in_0", 80.0)) == []
    assert _find(("left", ":C_15_0", 2.0), ("straight", "n_out_0", 2.0)) == []


def test_each_vehicle_keeps_its_row_length_and_speed() -> None:
    (_, first), (_, second) = _find(
        ("right", "w_in_0", 10.0), ("away", "w_in_0", 30.0), ("straight", "w_in_1", 50.0)
    )
    assert (first.at, first.row, first.length, first.speed) == (0, 3, 7.0, 3.0)
    assert (second.at, second.row, second.length, second.speed) == (2, 0, 4.0, 5.0)
